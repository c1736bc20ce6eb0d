"""How long a fresh machine takes from the clone to the first result by the README's commands, and what is installed.

`$PALPATE_BEFORE` names another commit, whose README is tried in turn with this one's. pip and uv find what they have
downloaded before; only the plain form is paired.
"""

from __future__ import annotations

import os
import resource
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.row import Row

ROOT = Path(__file__).parents[2]
RESULT = "palpate sweep loads"
ROUNDS = 3
MEGABYTE = 1e6
HALF = 0.5


def measure() -> Iterator[Row]:
    before = os.environ.get("PALPATE_BEFORE")
    commits = ["HEAD"] if before is None else ["HEAD", before]
    rounds = [[_tried(commit, "python3") for commit in commits] for _ in range(ROUNDS)]
    best = [min(each) for each in zip(*rounds, strict=True)]
    for commit, (seconds, processor, size) in zip(commits, best, strict=True):
        yield Row(
            f"{commit}: clone to first result, pip", f"{seconds:.1f} s, {processor:.1f} s of processor, {size:.0f} MB"
        )
    if before is not None:
        share = best[0][0] / best[1][0]
        yield Row(f"  of the time of {before}", f"{share:.2f}", f"<= {HALF}", share <= HALF)
    yield Row("HEAD: clone to first result, uv", _told(*min(_tried("HEAD", "uv") for _ in range(ROUNDS))))


def _told(seconds: float, processor: float, size: float) -> str:
    return f"{seconds:.1f} s, {processor:.1f} s of processor, {size:.0f} MB"


def _tried(commit: str, tool: str) -> tuple[float, float, float]:
    """Seconds on the clock and of the processor, and what lies in .venv [MB] afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        files = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
        subprocess.run(["tar", "-xf", "-"], cwd=folder, input=files, check=True)
        command = _command((Path(folder) / "README.md").read_text(encoding="utf-8"), tool)
        own = {name: value for name, value in os.environ.items() if name not in ("VIRTUAL_ENV", "UV_COMPILE_BYTECODE")}
        used, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(command, shell=True, cwd=folder, check=True, capture_output=True, env=own)
        taken, now = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        processor = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
        installed = sum(path.lstat().st_size for path in (Path(folder) / ".venv").rglob("*"))
        return taken, processor, installed / MEGABYTE


def _command(readme: str, tool: str) -> str:
    """The commands of a README up to its first result, from the first line that begins with a tool."""
    lines = iter(readme.splitlines())
    found = [next(line for line in lines if line.startswith(f"{tool} "))]
    while RESULT not in found[-1]:
        found.append(next(lines))
    return " && ".join(line.partition("#")[0].strip() for line in found)
