"""However a command ends, its outputs are at zero and what it reported is there; an exchanged sample ends a run."""

from __future__ import annotations

import errno
import os
import random
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import palpate as package
from palpate import LoadSweep, Run, get_design
from palpate.drivers.devices.sample_changer import ModbusSampleChanger
from palpate.extend import Bench, Lab, ModbusDevice, Recorder, Scene
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.errors import SampleError
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.signals.estimate import fit_sine
from palpate.procedures.console.terminal import Progress
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.records.chain import RECORD
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.testing import steps
from tests.chance import amplitude_ratio
from tests.examples.relaxation import Relaxation
from tests.kills import SERVED_FAULTS, Commands, rounds
from tests.procedures.conftest import HEADER, OFF, Benches, Palpate, outputs
from tests.shares import first_of

pytestmark = pytest.mark.usefixtures("foreground")
SMALL = ("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--out", "day")
DRIVEN = (1, "sample 1, 3 N")  # a point is stored, and the next load is about to be set


def send(number: signal.Signals) -> None:
    os.kill(os.getpid(), number)


def at_second_load(action: Callable[[], object]) -> Progress:
    def progress(done: int, _total: int, what: str) -> None:
        if (done, what) == DRIVEN:
            action()

    return progress


def ended_safe(benches: Benches, status: str) -> None:
    assert outputs(benches[0]) == OFF
    run = Run.open(Path("day"))
    assert (run.status, [p["load_N"] for p in run.points()][:1]) == (status, [2.0])


@pytest.mark.parametrize("device", first_of(["amplifier", "generator"]))
def test_a_second_interrupt_while_outputs_are_being_switched_off_does_not_keep_them_on(
    palpate: Palpate, benches: Benches, on_progress: Any, monkeypatch: pytest.MonkeyPatch, device: str
) -> None:
    again: list[object] = []

    def interrupt() -> None:
        simulated = getattr(benches[0], device)
        write = simulated.write

        def interrupted(values: dict[str, float]) -> None:
            again.append(values)
            send(signal.SIGINT)
            write(values)

        monkeypatch.setattr(simulated, "write", interrupted)
        send(signal.SIGINT)

    on_progress(at_second_load(interrupt))
    assert palpate(*SMALL).status == 130
    assert again
    ended_safe(benches, "stopped")


@pytest.mark.parametrize(
    ("crash", "message"),
    first_of(
        [
            (RuntimeError("no fonts"), "the run is kept in {}, but its report crashed (RuntimeError: no fonts)"),
            (
                OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)),
                "cannot write {}/plot.png: No space left on device; free",
            ),
        ]
    ),
)
def test_a_plot_that_crashes_is_one_error_when_outputs_are_off_and_the_run_is_complete(
    palpate: Palpate, benches: Benches, monkeypatch: pytest.MonkeyPatch, crash: Exception, message: str
) -> None:
    drawn: list[tuple[bool, bool, float]] = []

    def savefig(_figure: object, _path: object, **_: object) -> None:
        drawn.append(outputs(benches[0]))
        raise crash

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", savefig)
    said = palpate(*SMALL)
    assert said.complaint.startswith(message.format(Path("day").absolute()))
    assert (said.status, drawn) == (1, [OFF])
    ended_safe(benches, "complete")


@pytest.mark.parametrize(
    ("wrong", "message"),
    first_of(
        [
            ({"temperature": 85.5}, "heat sink at 85.5 degC"),
            ({"output_current": 4.0}, "5.66 A peak"),  # 4 A rms: a trip that the device has lost
        ]
    ),
)
def test_an_amplifier_that_is_too_hot_or_passes_its_limit_without_a_trip_is_switched_off(
    palpate: Palpate, benches: Benches, on_progress: Any, monkeypatch: pytest.MonkeyPatch, wrong: dict[str, float],
    message: str,
) -> None:  # fmt: skip
    def doctor() -> None:
        read = benches[0].amplifier.read
        monkeypatch.setattr(benches[0].amplifier, "read", lambda name: wrong[name] if name in wrong else read(name))

    on_progress(at_second_load(doctor))
    said = palpate(*SMALL)
    assert (said.status, message in said.complaint) == (1, True)
    ended_safe(benches, "failed")


def test_ctrl_c_also_ends_what_the_simulation_computes(monkeypatch: pytest.MonkeyPatch) -> None:
    given_up = Mock()
    monkeypatch.setattr(VirtualClock, "give_up_soon", given_up)
    with pytest.raises(KeyboardInterrupt), package.open_bench(scene="ideal"):
        assert not given_up.called
        signal.raise_signal(signal.SIGINT)
    assert given_up.call_count == 1


# --- a sample that is exchanged: whoever wrote the procedure or the driver of the changer --------------


@pytest.fixture
def sim(nothing_left_behind: None, scene: Scene) -> Iterator[SimulatedBench]:
    with SimulatedBench(scene, samples=[SAMPLES[name] for name in "12"]) as simulated:
        yield simulated


@pytest.mark.parametrize(
    "procedure", [Relaxation(sample="2"), LoadSweep(("2",), (2.0, 3.0, 4.0), dwell=0.2)], ids=lambda each: each.name
)
def test_a_sample_that_is_exchanged_between_two_points_ends_the_run_before_the_next_is_stored(
    procedure: Relaxation | LoadSweep,
    bench: Bench,
    sim: SimulatedBench,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A driver of another package need not look at the sample whenever settings are looked at, as ours does."""
    monkeypatch.setattr(ModbusSampleChanger, "differences", ModbusDevice.differences)

    def exchange(done: int, _total: int, what: str) -> None:
        if done == 1:
            sim.rig.mount(SAMPLES["1"])
            sim.rig.mount(SAMPLES["2"])  # the right one lies there again, but it was away

    lab = Lab(bench, get_design("single"), THESIS_LOAD_CELL)
    recorder = Recorder.create(tmp_path / "run", HEADER, steps(exchange))
    with recorder as record, pytest.raises(SampleError, match=r"exchanged . times"):
        conduct(procedure, lab, record)
    assert len(Run.open(tmp_path / "run").points()) == 1


# --- killed: every point that was reported is there ----------------------------------------------------


SWEEP = ("sweep", "loads", "--quiet", "--loads", "1.5 N:4 N:0.01 N", "--out")
BRIEF = ("sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--out")


@pytest.fixture(scope="module")
def commands() -> Iterator[Commands]:
    with Commands() as server:
        yield server


def check_reported(run: Run, reported: int) -> None:
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


@pytest.mark.slow
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
    check_reported(run, end.reported)
    shown = palpate("runs", "show", "run", "--json").object
    assert (shown["points"], shown["status"], shown["simulated"]) == (run.points(), "running", True)


@pytest.mark.slow
def test_a_killed_run_that_goes_on_ends_as_one_that_was_not_killed_and_the_watchdog_has_no_output_left(
    commands: Commands, tmp_path: Path
) -> None:
    whole = tmp_path / "whole"
    ticks = commands.run(*BRIEF, str(whole)).ticks
    chance = random.Random(6)
    driven = 0
    for kill in range(3):
        folder = tmp_path / str(kill)
        end = commands.killed(
            chance.randrange(1, ticks // 3) + kill * ticks // 3, 0.02 * chance.random(), *BRIEF, str(folder)
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
    assert {what: found[what] for what in SERVED_FAULTS if found[what]} == {}
    assert min(found[what] for what in ("killed", "interrupted", "resumed", "noticed")) > 0
