"""No calibration is lost: a run is complete once its calibration is kept, and what is left is done by resuming it."""

from __future__ import annotations

import errno
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import DEFAULT, Mock

import pytest

import palpate as package
from palpate.instrument.calibration.files import read_calibration
from palpate.procedures.records.run import Run
from palpate.simulators.bench import SimulatedBench
from tests.calibration_kills import COMMANDS, ERRORS, FAULTS, in_process, served
from tests.procedures.conftest import Palpate
from tests.runs import rehash
from tests.shares import first_of

CELL = ("calibrate", "load-cell", "--loads", "1.5 N, 4 N, 7 N", "--quiet")
MOUNTINGS = (*COMMANDS["mountings"], "--quiet")
STORE = Path("runs/calibrations")
Strike = Callable[[int, BaseException], None]


@pytest.fixture
def strike(monkeypatch: pytest.MonkeyPatch) -> Strike:
    """Has an error raised where the n-th file is put into its place. The record of a run is the first."""

    def at(count: int, error: BaseException) -> None:
        replace = Mock(side_effect=[*[DEFAULT] * (count - 1), error, *[DEFAULT] * 99], wraps=os.replace)
        monkeypatch.setattr(os, "replace", replace)

    return at


@pytest.mark.parametrize(("at", "there"), first_of([(6, 4), (2, 0)]))
def test_a_run_that_is_stopped_before_its_calibration_is_stored_is_not_complete_and_resuming_stores_it(
    palpate: Palpate, strike: Strike, at: int, there: int
) -> None:
    strike(at, KeyboardInterrupt())
    assert palpate(*CELL, "--out", "day").status == 130
    files = {"certificate.md", "certificate.html", "certificate.xml", "calibration.toml"}
    assert (len(files & {path.name for path in Path("day").iterdir()}), any(STORE.glob("*"))) == (there, False)
    assert Run.open(Path("day")).status == "stopped"
    assert palpate("runs", "resume", "day", "--quiet").status == 0
    assert Run.open(Path("day")).status == "complete"
    (stored,) = STORE.iterdir()
    assert stored.read_bytes() == Path("day/calibration.toml").read_bytes()
    assert read_calibration(stored).source == "day"


@pytest.mark.parametrize("code", first_of([errno.ENOSPC, errno.EROFS, errno.EACCES]))
def test_a_store_that_cannot_be_written_to_is_told_with_the_remedy_which_works(
    palpate: Palpate, strike: Strike, code: int
) -> None:
    strike(6, OSError(code, os.strerror(code)))
    said = palpate(*CELL, "--out", "day").complaint
    for each in ("the calibration is kept in ", os.strerror(code), "and later runs do not use it"):
        assert each in said
    run = Run.open(Path("day"))
    assert (run.status, [event["kind"] for event in run.events()]) == ("complete", ["measured", "unstored"])
    remedy = said.splitlines()[0].partition("then run palpate ")[2].split()
    told = palpate(*remedy, "--json").object
    (stored,) = STORE.iterdir()
    assert (told["calibration_file"], told["installed"]) == (str(stored), True)
    assert "was installed already" in palpate(*remedy).out
    assert "is complete; there is nothing to resume" in palpate("runs", "resume", "day").complaint


def test_a_complete_run_whose_calibration_is_not_stored_is_resumed_to_store_it(palpate: Palpate) -> None:
    day = Path("day")
    assert palpate(*CELL, "--out", "day").status == 0
    digest = Run.open(day).digest()
    for gone in ((), ("calibration.toml", "certificate.md")):
        for name in gone:
            (day / name).unlink()
        shutil.rmtree("runs")
        assert palpate("runs", "resume", "day", "--quiet").status == 0
        (stored,) = STORE.iterdir()
        assert stored.read_bytes() == (day / "calibration.toml").read_bytes()
        assert (day / "certificate.md").exists()
        assert (Run.open(day).digest(), Run.open(day).status) == (digest, "complete")
    rehash(day, status="running")  # as if it had been killed just before its last row
    assert palpate("runs", "resume", "day", "--quiet").status == 0
    assert Run.open(day).status == "complete"


def test_an_older_calibration_does_not_replace_a_newer_one(palpate: Palpate) -> None:
    assert palpate(*CELL, "--out", "old").status == 0
    rehash(Path("old"), status="stopped", header=lambda header: header.update(started="2001-02-03T04:05:06+00:00"))
    assert palpate(*CELL, "--out", "new").status == 0
    (stored,) = STORE.iterdir()
    said = palpate("runs", "resume", "old", "--quiet").complaint
    assert f"{stored} is newer, of new; remove it if this one shall be used" in said
    assert read_calibration(stored).source == "new"
    assert Run.open(Path("old")).status == "complete"


def test_what_has_no_calibration_to_install_says_why(palpate: Palpate) -> None:
    assert palpate("sweep", "loads", "--samples", "1", "--loads", "2 N", "--out", "day", "--quiet").status == 0
    assert "day: has no calibration, since its procedure makes none" in palpate("runs", "install", "day").complaint


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
