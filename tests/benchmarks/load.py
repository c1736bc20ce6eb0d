"""Sweeps on a served bench while forty other programs want the processor: does the watchdog trip on a living one?"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.benchmarks.row import Row

BUSY = 40
SWEEPS = 20
LONGEST = 3600  # s, after which a busy program ends, whatever became of the one that started it
PALPATE = (sys.executable, "-c", "from procedures.cli import main; main()")
SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", "--quiet")
SPIN = f"""
import os, time
parent, end = os.getppid(), time.monotonic() + {LONGEST}
while os.getppid() == parent and time.monotonic() < end:
    for _ in range(1_000_000):
        pass
"""


def measure(sweeps: int = SWEEPS, busy: int = BUSY) -> Iterator[Row]:
    """How many sweeps end well, each on the same bench of another process."""
    with TemporaryDirectory() as folder, _served(Path(folder)) as bench, _busy(busy):
        took, failures = [], []
        for number in range(sweeps):
            start = time.monotonic()
            done = subprocess.run(
                [*PALPATE, *SWEEP, "--bench", str(bench), "--out", str(Path(folder) / str(number))],
                input="\n",
                capture_output=True,
                text=True,
                check=False,
            )
            took.append(time.monotonic() - start)
            failures += [done.stderr.strip()] if done.returncode else []
        load = os.getloadavg()[0]
    well = sweeps - len(failures)
    yield Row(
        f"served sweeps that end well beside {busy} busy programs, load {load:.0f}, {max(took):.0f} s at most",
        f"{well} of {sweeps}" + (f": {failures[0]}" if failures else ""),
        f"{sweeps} of {sweeps}",
        well == sweeps,
    )


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
def _busy(count: int) -> Iterator[None]:
    programs = [subprocess.Popen([sys.executable, "-S", "-E", "-c", SPIN]) for _ in range(count)]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()
