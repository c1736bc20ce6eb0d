"""A study of a thousand scenes in closed form, by `palpate study` as a user runs it; what a second worker brings."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from instrument.config import parse
from procedures.cli.executors import executor_of
from procedures.cli.study_cell import Sweep
from procedures.study.description import StudyFile, study_of
from procedures.study.results import read_results
from procedures.study.run import run
from procedures.study.store import Store
from tests.benchmarks.row import Row

SCENES, GOAL = 1000, 60.0
CELLS, SPEED_UP = 400, 1.8
STUDY = 'name = "benchmark"\n[axes]\nseed = "{first}-{last}"\n'
FIGURE = "six load sets in closed form"


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        seconds = _command(Path(folder))
        yield Row(
            f"study, {SCENES} scenes of {FIGURE}: the command", f"{seconds:.1f} s", f"< {GOAL:g} s", seconds < GOAL
        )
        (one, first), (two, second) = (_computed(Path(folder), workers) for workers in (1, 2))
    gain = one / two
    measured = f"{one:.1f} / {two:.1f} s = {gain:.2f}"
    yield Row(f"study, {CELLS} scenes: one worker / two", measured, f">= {SPEED_UP}", gain >= SPEED_UP)
    yield Row("study: results of both", "the same" if first == second else "differ", "the same", first == second)


def _command(folder: Path) -> float:
    (folder / "study.toml").write_text(STUDY.format(first=1, last=SCENES), encoding="utf-8")
    palpate = str(Path(sys.executable).with_name("palpate"))
    start = time.perf_counter()
    subprocess.run([palpate, "study", "study.toml", "--workers", "2", "--quiet"], cwd=folder, check=True)
    return time.perf_counter() - start


def _computed(folder: Path, workers: int) -> tuple[float, str]:
    """Seconds for the cells alone, by workers that are there already, and the digest of the results."""
    with executor_of(workers, None) as (executor, _):
        for name, first, last in (("warm", 1, 4 * workers), ("timed", 1, CELLS)):
            file = parse(STUDY.format(first=first, last=last).encode(), StudyFile, name)
            study, out = study_of(file, name), folder / f"{name} {workers}"
            with Store(out, {"study": file.model_dump(mode="json")}) as store:
                start = time.perf_counter()
                run(study, Sweep.of(study, name), executor, store, _nobody, 4 * workers)
                seconds = time.perf_counter() - start
    return seconds, read_results(out).digest()


def _nobody(_done: int, _total: int, _what: str) -> None:
    """Hears of progress and does nothing."""
