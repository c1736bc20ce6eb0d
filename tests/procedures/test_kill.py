"""A sweep that is killed leaves every point it reported; one that is told to stop leaves its outputs off, too."""

from __future__ import annotations

import random
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from palpate.instrument.signals.estimate import fit_sine
from palpate.procedures.records.chain import RECORD
from palpate.procedures.records.run import Run
from tests.kills import Commands
from tests.procedures.conftest import OFF, Palpate
from tests.ratios import amplitude_ratio
from tests.served_kills import FAULTS, rounds

pytestmark = pytest.mark.slow

SWEEP = ("sweep", "loads", "--quiet", "--loads", "1.5 N:4 N:0.01 N", "--out")
SMALL = ("sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--out")


@pytest.fixture(scope="module")
def commands() -> Iterator[Commands]:
    with Commands() as server:
        yield server


def check(run: Run, reported: int) -> None:
    """Every point that was reported is there, and its waveforms give it again."""
    points = run.points()
    assert [p["id"] for p in points] == list(range(1, len(points) + 1))
    assert len(points) >= reported
    stored = {(w.point_id, w.name): w for w in run.waveforms()}
    assert stored.keys() == {(p["id"], name) for p in points for name in ("rigid", "total")}
    for p in points:
        films = np.array([stored[p["id"], name].samples for name in ("rigid", "total")])
        fit = fit_sine(np.arange(250) / 250.0, films, 10.0)
        assert amplitude_ratio(fit, 0, 1)[0] * 68.60 / 5.995 == pytest.approx(p["force_ratio"], rel=1e-6)


@pytest.mark.parametrize(("word", "count"), [("tick", 20), ("tick", 155), ("point", 9)])
def test_a_killed_sweep_keeps_every_point_it_reported(
    commands: Commands, palpate: Palpate, tmp_path: Path, word: str, count: int
) -> None:
    end = commands.signalled(signal.SIGKILL, word, count, *SWEEP, str(tmp_path / "run"))
    assert end.status == -signal.SIGKILL
    if not (tmp_path / "run" / RECORD).exists():
        assert end.reported == 0
        return
    run = Run.open(tmp_path / "run")
    check(run, end.reported)
    shown = palpate("runs", "show", "run", "--json").object
    assert (shown["points"], shown["status"], shown["simulated"]) == (run.points(), "running", True)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_sweep_that_is_told_to_stop_ends_with_its_outputs_off(
    commands: Commands, tmp_path: Path, number: signal.Signals
) -> None:
    end = commands.signalled(number, "tick", 110, *SWEEP, str(tmp_path / "run"))
    assert (end.status, end.outputs, end.reported > 0) == (128 + number, OFF, True)
    run = Run.open(tmp_path / "run")
    assert run.status == "stopped"
    check(run, end.reported)


def test_a_killed_run_that_goes_on_ends_as_one_that_was_not_killed_and_the_watchdog_has_no_output_left(
    commands: Commands, tmp_path: Path
) -> None:
    whole = tmp_path / "whole"
    ticks = commands.run(*SMALL, str(whole)).ticks
    chance = random.Random(6)
    driven = 0
    for kill in range(3):
        folder = tmp_path / str(kill)
        end = commands.killed(
            chance.randrange(1, ticks // 3) + kill * ticks // 3, 0.02 * chance.random(), *SMALL, str(folder)
        )
        assert (end.status, end.left) == (-signal.SIGKILL, 0.0)
        driven += bool(end.driven)
        stored = Run.open(folder).points()
        assert len(stored) >= end.reported
        assert commands.run("runs", "resume", str(folder), "--quiet").status == 0
        run = Run.open(folder)
        assert run.points()[: len(stored)] == stored
        assert (run.digest(), run.summary) == (Run.open(whole).digest(), Run.open(whole).summary)
    assert driven


# --- on a served bench: a share of `tests.benchmarks served_kills` -------------------------------------


@pytest.mark.slow
def test_no_point_is_that_of_another_sample_or_lost_or_silently_missing(
    tmp_path: Path, nothing_left_behind: None
) -> None:
    """Seeds whose blows are a kill, each other signal, a hand at the sample and another client's order."""
    with rounds(tmp_path, "real_bench") as played:
        found = Counter(played.play(11))
    assert {what: found[what] for what in FAULTS if found[what]} == {}
    assert min(found[what] for what in ("killed", "interrupted", "resumed", "noticed")) > 0
