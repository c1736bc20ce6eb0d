"""Sweeps on served benches while forty other programs want the processor: does the watchdog trip on a living one?"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.benchmarks.row import Row

BUSY = 40
SWEEPS = 20
AT_ONCE = 4  # each adds to the load
LONGEST = 3600  # s, after which a busy program ends, whatever became of the one that started it
PALPATE = (sys.executable, "-c", "from palpate.procedures.commands import main; main()")
SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", "--quiet")
SPIN = f"""
import os, time
parent, end = os.getppid(), time.monotonic() + {LONGEST}
while os.getppid() == parent and time.monotonic() < end:
    for _ in range(1_000_000):
        pass
"""


def measure(sweeps: int = SWEEPS, programs: int = BUSY) -> Iterator[Row]:
    """How many sweeps end well, several at once, each on a bench of another process."""
    with TemporaryDirectory() as place, busy(programs), ThreadPoolExecutor(AT_ONCE) as pool:
        folders = [Path(place) / str(number) for number in range(sweeps)]
        results = list(pool.map(_swept, folders))
        load = os.getloadavg()[0]
    failures = [said for _, said in results if said]
    well, longest = sweeps - len(failures), max(took for took, _ in results)
    yield Row(
        f"served sweeps that end well, {AT_ONCE} at once beside {programs} busy programs, load {load:.0f},"
        f" {longest:.0f} s at most",
        f"{well} of {sweeps}" + (f": {failures[0]}" if failures else ""),
        f"{sweeps} of {sweeps}",
        well == sweeps,
    )


def _swept(folder: Path) -> tuple[float, str]:
    """How long one sweep took [s], and what it said where it failed."""
    folder.mkdir()
    with _served(folder) as bench:
        start = time.monotonic()
        done = subprocess.run(
            [*PALPATE, *SWEEP, "--bench", str(bench), "--out", str(folder / "run")],
            input="\n",
            capture_output=True,
            text=True,
            check=False,
        )
    return time.monotonic() - start, (done.stderr.strip() or "failed") if done.returncode else ""


@contextmanager
def _served(folder: Path) -> Iterator[Path]:
    bench = folder / "bench.toml"
    command = [*PALPATE, "serve", "thesis_single", "--samples", "1", "--out", str(bench), "--json"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        while server.stdout.readline() != "}\n":  # the bench is there
            pass
        try:
            yield bench
        finally:
            server.communicate("quit\n")


@contextmanager
def busy(count: int) -> Iterator[None]:
    programs = [subprocess.Popen([sys.executable, "-S", "-E", "-c", SPIN]) for _ in range(count)]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()
