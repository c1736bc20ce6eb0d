"""A study of a thousand scenes in closed form, by `palpate study` as a user runs it; what a second worker brings."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from pathlib import Path

from palpate.instrument.config import parse
from palpate.procedures.study.description import StudyFile, study_of
from palpate.procedures.study.results import read_results
from palpate.procedures.study.run import Store, run
from palpate.procedures.virtual.executors import executor_of
from palpate.procedures.virtual.study_cell import StudyComputation
from tests.benchmarks.row import Row

SCENES, GOAL = 1000, 60.0
CELLS, SPEED_UP = 400, 1.8
STUDY = 'name = "benchmark"\n[axes]\nseed = "{first}-{last}"\n'
FIGURE = "six load sets in closed form"


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seconds = _command(folder)
        yield Row(
            f"study, {SCENES} scenes of {FIGURE}: the command", f"{seconds:.1f} s", f"< {GOAL:g} s", seconds < GOAL
        )
        digests = {}
        taken = {}
        for workers in (1, 2):
            with executor_of(workers, None) as (executor, _):
                taken[workers], digests[workers] = _computed(folder / str(workers), executor, workers)
        gain = taken[1] / taken[2]
        measured = f"{taken[1]:.1f} / {taken[2]:.1f} s = {gain:.2f}"
        yield Row(f"study, {CELLS} scenes: one worker / two", measured, f">= {SPEED_UP}", gain >= SPEED_UP)
        yield _same("study: results of both", digests[1], digests[2])
        if importlib.util.find_spec("distributed") is None:
            yield Row("study: results on dask", "distributed is not installed")
            return
        from distributed import LocalCluster

        with (
            LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
            executor_of(None, cluster.scheduler_address) as (executor, workers),
        ):
            yield _same("study: results on dask", digests[1], _computed(folder / "dask", executor, workers)[1])


def _same(figure: str, first: str, second: str) -> Row:
    return Row(figure, "the same" if first == second else "differ", "the same", first == second)


def _command(folder: Path) -> float:
    (folder / "study.toml").write_text(STUDY.format(first=1, last=SCENES), encoding="utf-8")
    palpate = str(Path(sys.executable).with_name("palpate"))
    start = time.perf_counter()
    subprocess.run([palpate, "study", "study.toml", "--workers", "2", "--quiet"], cwd=folder, check=True)
    return time.perf_counter() - start


def _computed(folder: Path, executor: Executor, workers: int) -> tuple[float, str]:
    """Seconds for the cells alone, by workers that are there already, and the digest of the results."""
    for name, last in (("warm", 4 * workers), ("timed", CELLS)):
        file = parse(STUDY.format(first=1, last=last).encode(), StudyFile, name)
        study = study_of(file, name)
        with Store(folder / name, {"study": file.model_dump(mode="json")}) as store:
            start = time.perf_counter()
            run(study, StudyComputation.of(study, name), executor, store, _nobody, 4 * workers)
            seconds = time.perf_counter() - start
    return seconds, read_results(folder / "timed").digest()


def _nobody(_done: int, _total: int, _what: str) -> None:
    """Hears of progress and does nothing."""
