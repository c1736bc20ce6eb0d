"""`palpate live`, or a command with --live, as a process whose page others open."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import palpate


def with_a_run(store: Path) -> Path:
    """The store, with a complete run `done` of three points."""
    with palpate.open_bench(seed=4) as bench:
        palpate.run(palpate.LoadSweep(samples=("1",), loads=(2.0, 3.0, 4.0)), bench, out=store / "done")
    return store


@dataclass(frozen=True, slots=True)
class Served:
    """A process that serves a page.

    Attributes:
        process: the process.
        address: address of the page.
        token: what a page needs to pause and stop the run; empty: nothing does.
    """

    process: subprocess.Popen[str]
    address: str
    token: str

    @property
    def port(self) -> int:
        return urlsplit(self.address).port or 0

    def ask(self, path: str, headers: Mapping[str, str] | None = None, method: str = "GET") -> tuple[int, str]:
        """Status and text of an answer. `headers`: further ones, or others."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.request(method, path, headers={} if headers is None else dict(headers))
        answer = connection.getresponse()
        try:
            return answer.status, answer.read().decode()
        finally:
            connection.close()

    @contextmanager
    def stream(self) -> Iterator[HTTPResponse]:
        """The stream of a new page, unread."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.request("GET", "/events")
        try:
            yield connection.getresponse()
        finally:
            connection.close()


def told(stream: HTTPResponse) -> Iterator[dict[str, Any]]:
    """The messages of a stream."""
    for line in stream:
        if line.startswith(b"data: "):
            yield json.loads(line.removeprefix(b"data: "))


def until(kind: str, heard: Iterator[dict[str, Any]]) -> list[dict[str, Any]]:
    """The messages up to the next one of a kind."""
    found = [next(heard)]
    while found[-1]["event"] != kind:
        found.append(next(heard))
    return found


def ids(messages: Iterable[dict[str, Any]]) -> list[int]:
    """The numbers of the points in messages."""
    return [each["id"] for each in messages if each["event"] == "point"]


@contextmanager
def served(store: Path, *words: str) -> Iterator[Served]:
    """A palpate command that serves a page, with a store of its own; it is killed at the end if it still runs."""
    command = [sys.executable, "-c", "from palpate.procedures.commands import main; main()", *words]
    with subprocess.Popen(
        command, env={**os.environ, "PALPATE_STORE": str(store)}, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None and process.stderr is not None
        try:
            own_run = "--live" in words and words[0] != "serve"
            told_by = process.stderr if "--live" in words else process.stdout
            address = told_by.readline().removeprefix("live page: ").strip()
            token = process.stderr.readline().strip().partition("#")[2] if own_run else ""
            yield Served(process, address, token)
        finally:
            process.kill()
