"""The same bytes however a simulated bench is entered: by the command, by pytest, by a script; and with numpy first.

Each entry and store is a process of its own that inherits no kernels. A script and a test take all seeds of a scene.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from palpate.instrument.arithmetic import KERNELS
from palpate.procedures.records.run import Run
from tests.benchmarks.row import Row

SCENES = ("thesis_single", "thesis_different_base", "everything", "noisy_lab")
SEEDS, STORES = int(os.environ.get("PALPATE_SEEDS", "20")), ("one", "two")
MEASURE = """
import palpate
def measure():
    for seed in range(1, {seeds} + 1):
        with palpate.open_bench(scene="{scene}", seed=seed) as bench:
            sweep = palpate.LoadSweep(samples=("1", "4"), loads=(2.0, 3.0), dwell=0.2)
            palpate.run(sweep, bench, out="{out}-" + str(seed))
"""
COMMAND = "from palpate.procedures.commands import main; main()"
SWEEP = ("sweep", "loads", "--samples", "1,4", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--quiet")


def measure() -> Iterator[Row]:
    for scene in SCENES:
        with tempfile.TemporaryDirectory() as folder:
            digests, signals = _digests(Path(folder), scene)
        for what, found in (("command, pytest and script", digests), ("these and numpy first, of signals", signals)):
            most = max(len(each) for each in found)
            yield Row(
                f"{scene}: digests a seed by {what}, {len(STORES)} stores, {SEEDS} seeds",
                f"{most} at most, {len(set().union(*found))} in all",
                f"1, {SEEDS}",
                most == 1 and len(set().union(*found)) == SEEDS,
            )


def _digests(folder: Path, scene: str) -> tuple[list[set[str]], list[set[str]]]:
    """Digests and digests of signals that each seed has by all entries."""
    digests, signals = [set[str]() for _ in range(SEEDS)], [set[str]() for _ in range(SEEDS)]
    for store in STORES:
        for entry in ("command", "pytest", "script", "numpy"):
            place = folder / store / entry
            place.mkdir(parents=True)
            _enter(place, entry, scene)
            for seed in range(1, SEEDS + 1):
                run = Run.open(place / f"run-{seed}")
                signals[seed - 1].add(run.signal_digest())
                if entry != "numpy":
                    digests[seed - 1].add(run.digest())
    return digests, signals


def _enter(place: Path, entry: str, scene: str) -> None:
    script = MEASURE.format(seeds=SEEDS, scene=scene, out=place / "run")
    own = {name: value for name, value in os.environ.items() if name not in KERNELS}
    own["PALPATE_STORE"] = str(place / "store")

    def start(*arguments: str) -> None:
        subprocess.run((sys.executable, *arguments), env=own, check=True, cwd=place, stdout=subprocess.DEVNULL)

    if entry == "command":
        for seed in range(1, SEEDS + 1):
            start("-c", COMMAND, *SWEEP, "--scene", scene, "--seed", str(seed), "--out", str(place / f"run-{seed}"))
    elif entry == "pytest":
        (place / "test_it.py").write_text(script.replace("measure", "test_it"), encoding="utf-8")
        start("-m", "pytest", "-q", "-p", "no:cacheprovider", "test_it.py")
    else:
        start("-c", ("import numpy\n" if entry == "numpy" else "") + script + "measure()")
