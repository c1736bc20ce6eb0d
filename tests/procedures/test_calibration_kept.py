"""No calibration is lost: a run is complete once its calibration is kept, and what is left is done by resuming it."""

from __future__ import annotations

import errno
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import palpate as package
from palpate.instrument.calibration.files import read_calibration
from palpate.procedures.records.run import Run
from palpate.simulators.bench import SimulatedBench
from tests.calibration_kills import COMMANDS, ERRORS, FAULTS, in_process, served
from tests.procedures.conftest import Palpate
from tests.runs import rehash

CELL = ("calibrate", "load-cell", "--loads", "1.5 N, 4 N, 7 N", "--quiet")
MOUNTINGS = (*COMMANDS["mountings"], "--quiet")
STORE = Path("runs/calibrations")
Strike = Callable[[int, BaseException], None]


@pytest.fixture
def strike(monkeypatch: pytest.MonkeyPatch) -> Strike:
    """Has an error raised where the n-th file is put into its place; 0: never. The record of a run is the first."""
    blow: list[Any] = [0, None]
    replace = os.replace

    def replaced(old: Any, new: Any) -> None:
        blow[0] -= 1
        if blow[0] == 0:
            raise blow[1]
        replace(old, new)

    monkeypatch.setattr(os, "replace", replaced)

    def at(count: int, error: BaseException) -> None:
        blow[:] = [count, error]

    return at


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.parametrize(("at", "there"), [(2, 0), (6, 4)])
def test_a_run_that_is_stopped_before_its_calibration_is_stored_is_not_complete_and_resuming_stores_it(
    palpate: Palpate, strike: Strike, at: int, there: int
) -> None:
    strike(at, KeyboardInterrupt())
    assert palpate(*CELL, "--out", "day").status == 130
    assert Run.open(Path("day")).status == "stopped"
    files = {"certificate.md", "certificate.html", "certificate.xml", "calibration.toml"}
    assert (len(names(Path("day")) & files), STORE.exists() and any(STORE.iterdir())) == (there, False)
    assert palpate("runs", "resume", "day", "--quiet").status == 0
    assert Run.open(Path("day")).status == "complete"
    (stored,) = STORE.iterdir()
    assert stored.read_bytes() == Path("day/calibration.toml").read_bytes()
    assert read_calibration(stored).source == "day"


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EACCES])
def test_a_store_that_cannot_be_written_to_is_told_with_the_remedy_which_works(
    palpate: Palpate, strike: Strike, code: int
) -> None:
    strike(6, OSError(code, os.strerror(code)))
    said = palpate(*CELL, "--out", "day")
    assert said.status == 1
    assert "the calibration is kept in " in said.complaint
    assert os.strerror(code) in said.complaint
    assert "and later runs do not use it" in said.complaint
    run = Run.open(Path("day"))
    assert (run.status, [event["kind"] for event in run.events()]) == ("complete", ["measured", "unstored"])
    remedy = said.complaint.splitlines()[0].partition("then run palpate ")[2].split()
    told = palpate(*remedy, "--json").object
    (stored,) = STORE.iterdir()
    assert (told["calibration_file"], told["installed"]) == (str(stored), True)
    assert "was installed already" in palpate(*remedy).out
    assert "is complete; there is nothing to resume" in palpate("runs", "resume", "day").complaint


def test_a_complete_run_whose_calibration_is_not_stored_is_resumed_to_store_it(palpate: Palpate) -> None:
    assert palpate(*CELL, "--out", "day").status == 0
    digest = Run.open(Path("day")).digest()
    for gone in (("runs",), ("runs", "day/calibration.toml", "day/certificate.md")):
        for path in map(Path, gone):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        assert palpate("runs", "resume", "day", "--quiet").status == 0
        (stored,) = STORE.iterdir()
        assert stored.read_bytes() == Path("day/calibration.toml").read_bytes()
        assert Path("day/certificate.md").exists()
        assert (Run.open(Path("day")).digest(), Run.open(Path("day")).status) == (digest, "complete")


def test_an_older_calibration_does_not_replace_a_newer_one(palpate: Palpate) -> None:
    assert palpate(*CELL, "--out", "old").status == 0
    rehash(Path("old"), status="stopped", header=lambda header: header.update(started="2001-02-03T04:05:06+00:00"))
    assert palpate(*CELL, "--out", "new").status == 0
    (stored,) = STORE.iterdir()
    said = palpate("runs", "resume", "old", "--quiet")
    assert (said.status, f"{stored} is newer, of new; remove it if this one shall be used" in said.complaint) == (
        1,
        True,
    )
    assert read_calibration(stored).source == "new"
    assert Run.open(Path("old")).status == "complete"


def test_what_has_no_calibration_to_install_says_why(palpate: Palpate) -> None:
    assert palpate("sweep", "loads", "--samples", "1", "--loads", "2 N", "--out", "day", "--quiet").status == 0
    assert "day: has no calibration, since its procedure makes none" in palpate("runs", "install", "day").complaint


def test_a_run_whose_calibration_is_stored_already_is_resumed_to_its_end(palpate: Palpate) -> None:
    assert palpate(*CELL, "--out", "day").status == 0
    rehash(Path("day"), status="running")  # as if it had been killed just before its last row
    assert palpate("runs", "resume", "day", "--quiet").status == 0
    assert Run.open(Path("day")).status == "complete"


@pytest.mark.usefixtures("own_store")
def test_a_calibration_of_a_real_bench_that_was_measured_is_kept_by_resuming_it(
    lab: str, sim: SimulatedBench, strike: Strike, tmp_path: Path
) -> None:
    series = package.LoadCellSeries(loads=(1.5, 4.0, 7.0))
    strike(4, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt), package.open_bench(bench=lab, operator=sim.operator) as bench:
        package.run(series, bench, out="day")
    before = Run.open(Path("day")).points()
    done = package.resume("day", bench=lab, accept_change=False)
    assert (done.run.points(), done.run.status) == (before, "complete")
    assert read_calibration(Path(done.outcome["calibration_file"])).source == "day"


@pytest.mark.slow
def test_a_scatter_of_mountings_that_could_not_be_stored_is_stored_by_resuming(
    palpate: Palpate, strike: Strike
) -> None:
    strike(3, OSError(errno.ENOSPC, "full"))
    said = palpate(*MOUNTINGS, "--out", "day")
    assert (said.status, Run.open(Path("day")).status) == (1, "complete")
    assert palpate("runs", "resume", "day", "--quiet").status == 0
    (stored,) = STORE.iterdir()
    assert read_calibration(stored).source == "day"
    assert "is complete; there is nothing to resume" in palpate("runs", "resume", "day").complaint


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("rounds", [in_process, served])
def test_no_kill_and_no_failed_write_loses_a_calibration_or_leaves_it_unused_unsaid(
    rounds: Any, tmp_path: Path
) -> None:
    chance = random.Random(7)
    with rounds(tmp_path, "load cell") as played:
        last = played.moments
        blows = [(n, "SIGKILL") for n in range(last["SIGKILL"] - 30, last["SIGKILL"], 10)]
        blows += [(last["ENOSPC"] - 3 * n, code) for n, code in enumerate(ERRORS)]
        for number, how in blows:
            found = played.play(number, how, chance)
            assert not sum(found[what] for what in FAULTS), (number, how, found)
