"""Studies in closed form: `palpate study` as a user runs it, cells alone, and what a second worker brings."""

from __future__ import annotations

import importlib.util
import resource
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
from palpate.procedures.virtual.study_cell import StudyComputation, executor_of
from tests.benchmarks.row import Row

SCENES, GOAL = 1000, 60.0
FEW, MANY, SPEED_UP = 5_000, 20_000, 1.8
THOUSAND = 0.6  # s for a thousand cells by two workers that are there already
MILLION, MILLION_S, MEMORY = 1_000_000, 360.0, 1000.0  # cells, s, MB
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
                for cells in (SCENES, FEW, MANY) if workers == 2 else (FEW,):
                    place = folder / f"{workers} {cells}"
                    taken[workers, cells], digests[workers, cells] = computed(place, executor, workers, cells)
        quick = taken[2, SCENES]
        yield Row(f"study, {SCENES} cells, after start", f"{quick:.2f} s", f"<= {THOUSAND:g} s", quick <= THOUSAND)
        gain = taken[1, FEW] / taken[2, FEW]
        measured = f"{taken[1, FEW]:.1f} / {taken[2, FEW]:.1f} s = {gain:.2f}"
        yield Row(f"study, {FEW} cells: one worker / two", measured, f">= {SPEED_UP}", gain >= SPEED_UP)
        seconds = taken[2, MANY] * (MILLION / MANY)
        yield Row(
            f"study, {MILLION} cells, from {MANY}", f"{seconds:.0f} s", f"<= {MILLION_S:g} s", seconds <= MILLION_S
        )
        used = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1000
        yield Row(f"study, {MANY} cells: largest process", f"{used:.0f} MB", f"<= {MEMORY:g} MB", used <= MEMORY)
        yield _same("study: results of both", digests[1, FEW], digests[2, FEW])
        if importlib.util.find_spec("distributed") is None:
            yield Row("study: results on dask", "distributed is not installed")
            return
        from distributed import LocalCluster

        with (
            LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
            executor_of(None, cluster.scheduler_address) as (executor, workers),
        ):
            on_dask = computed(folder / "dask", executor, workers, FEW)[1]
            yield _same("study: results on dask", digests[1, FEW], on_dask)


def _same(figure: str, first: str, second: str) -> Row:
    return Row(figure, "the same" if first == second else "differ", "the same", first == second)


def _command(folder: Path) -> float:
    (folder / "study.toml").write_text(STUDY.format(first=1, last=SCENES), encoding="utf-8")
    palpate = str(Path(sys.executable).with_name("palpate"))
    start = time.perf_counter()
    subprocess.run([palpate, "study", "study.toml", "--workers", "2", "--quiet"], cwd=folder, check=True)
    return time.perf_counter() - start


def computed(folder: Path, executor: Executor, workers: int, cells: int) -> tuple[float, str]:
    """Seconds for so many cells alone, by workers that are there already, and the digest of the results."""
    for name, last in (("warm", 4 * workers), ("timed", cells)):
        file = parse(STUDY.format(first=1, last=last).encode(), StudyFile, name)
        study = study_of(file, name)
        with Store(folder / name, {"study": file.model_dump(mode="json")}) as store:
            start = time.perf_counter()
            run(study, StudyComputation.of(study, name).block, executor, store, _nobody, 4 * workers)
            seconds = time.perf_counter() - start
    return seconds, read_results(folder / "timed").digest()


def _nobody(_done: int, _total: int, _what: str) -> None:
    """Hears of progress and does nothing."""
