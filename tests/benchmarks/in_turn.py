"""Runs a script with this checkout and in turn with another one that the environment variable BESIDE names.

Machines differ and have their moods, so what counts is the ratio of both. The other checkout needs no environment of
its own as long as it needs the same packages: `git worktree add ../before COMMIT`, then `BESIDE=../before`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any

ROOT = Path(__file__).parents[2]
USED = """
import json, os, resource, sys, time
def used():
    use = resource.getrusage(resource.RUSAGE_SELF)
    return {"cpu": use.ru_utime + use.ru_stime, "wall": time.perf_counter(), "switches": use.ru_nvcsw}
def spent(before):
    now = used()
    return {name: now[name] - before[name] for name in now}
"""


def checkouts() -> list[Path]:
    """This checkout, and the one beside which it is measured."""
    return [ROOT, *([Path(os.environ["BESIDE"]).resolve()] if "BESIDE" in os.environ else [])]


def in_turn(script: str, rounds: int) -> list[dict[str, float]]:
    """What the script prints last, a JSON object of numbers: of each the least in some rounds, for each checkout."""
    found: list[list[dict[str, float]]] = [[] for _ in checkouts()]
    for _ in range(rounds):
        for checkout, results in zip(checkouts(), found, strict=True):
            with TemporaryDirectory() as folder:
                done = subprocess.run(
                    _command(script), cwd=folder, env=_environment(checkout, folder), stdout=subprocess.PIPE, text=True,
                    check=True,
                )  # fmt: skip
            results.append(json.loads(done.stdout.splitlines()[-1]))
    return [{name: min(each[name] for each in results) for name in results[0]} for results in found]


def served(
    script: str, ask: Callable[[dict[str, Any], Callable[[], dict[str, float]]], float], rounds: int
) -> list[float]:
    """The least of what `ask` finds in some rounds, for each checkout, whose scripts run all the while.

    Args:
        script: prints a JSON object once it is ready, and then another one for each line that it reads.
        ask: gets the first object, and a function that returns the next ones.
        rounds: number of rounds.
    """
    with ExitStack() as stack:
        running = []
        for checkout in checkouts():
            folder = stack.enter_context(TemporaryDirectory())
            program = stack.enter_context(
                subprocess.Popen(
                    _command(script), cwd=folder, env=_environment(checkout, folder), stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE, text=True,
                )
            )  # fmt: skip
            assert program.stdin is not None
            assert program.stdout is not None
            stack.callback(program.stdin.close)
            running.append((json.loads(program.stdout.readline()), program.stdin, program.stdout, list[float]()))
        for _ in range(rounds):
            for ready, typed, printed, results in running:
                results.append(ask(ready, lambda typed=typed, printed=printed: _next(typed, printed)))  # type: ignore[misc]
        return [min(results) for *_, results in running]


def beside(values: Sequence[float], shown: Callable[[float], str]) -> str:
    """A figure, and how it was in the other checkout."""
    own, *before = values
    return shown(own) + "".join(f"; before {shown(each)}: {own / each:.2f}" for each in before)


def _command(script: str) -> list[str]:
    return [sys.executable, "-c", USED + script]


def _environment(checkout: Path, folder: str) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(checkout), "PALPATE_STORE": folder}


def _next(typed: IO[str], printed: IO[str]) -> dict[str, float]:
    typed.write("\n")
    typed.flush()
    found: dict[str, float] = json.loads(printed.readline())
    return found
