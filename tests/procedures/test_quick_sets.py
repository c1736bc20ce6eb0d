"""Bench time saved where only the ratio is sought: a quick approach, and load sets at a known amplitude.

Neither is less safe: no step is longer, the force is read after each, and it is watched while the films settle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from palpate.extend import Bench, DeviceError, DynamicLoadWork, Lab, Recorder, SafetyError
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.steps.probe import APPROACH_STEP, approach, preload
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import HEADER, OFF, happens_in, outputs
from tests.procedures.test_servo import limited, now, open_bridge, stiffen

LOAD, PRELOAD = 2.0, 1.2  # N


@dataclass
class Set:
    """A bench on which a load was set once by the load cell."""

    sim: SimulatedBench
    work: DynamicLoadWork


@pytest.fixture
def first(sim: SimulatedBench, bench: Bench, tmp_path: Path) -> Iterator[Set]:
    with Recorder.create(tmp_path, HEADER) as record:
        work = DynamicLoadWork(Lab(bench, sim.scene.design, THESIS_LOAD_CELL), record, (LOAD,), 10.0)
        bench.operator.mount(SAMPLES["1"])
        work.hold(approach(bench, THESIS_LOAD_CELL, PRELOAD, "sample 1").force)
        work.measured(LOAD, "first", 0.1)
        yield Set(sim, work)


# --- load sets -----------------------------------------------------------------------------------------


def test_a_set_made_again_is_a_new_one_and_takes_half_a_second_beside_its_dwell(first: Set) -> None:
    sets, amplitude, began = [], first.work.servo.amplitude, first.sim.clock.now_ns()
    for _ in range(4):
        point = first.work.again(LOAD, "again", 0.1)
        assert point.valid
        assert point.load_measured_N == pytest.approx(LOAD, abs=0.1)
        sets.append(first.sim.rig.set_at_ns)
    assert (len(set(sets)), first.work.servo.amplitude) == (4, amplitude)
    assert first.sim.clock.now_ns() - began <= 4 * (0.5 + 0.1 + 0.1) * 1e9


def test_the_drive_is_off_for_a_cycle_before_a_set_is_made_again(first: Set) -> None:
    began = first.sim.clock.now_ns()
    first.work.servo.again()
    assert first.sim.clock.now_ns() - began == 100_000_000
    time = np.arange(began + 60_000_000, began + 100_000_000, 500_000)
    assert np.ptp(first.sim.rig.cell_force(time)) < 0.05 * LOAD


@pytest.mark.parametrize("moment", [0.15, 0.45])  # s: while the films settle, in the dwell
def test_too_much_force_stops_a_set_that_is_made_again(first: Set, moment: float) -> None:
    first.work.lab.bench.force_limit = PRELOAD + LOAD
    happened = first.sim.clock.now_ns() + round(1e9 * moment)
    happens_in(first.sim, moment, lambda: stiffen(first.sim))
    with pytest.raises(SafetyError, match="passes the bench's limit"):
        first.work.again(LOAD, "again", 0.2)
    assert outputs(first.sim) == OFF
    assert first.sim.clock.now_ns() - happened <= 0.4e9


def test_a_load_that_has_drifted_is_set_by_the_load_cell_anew(first: Set) -> None:
    stiffen(first.sim, 1.3)
    point = first.work.again(LOAD, "again", 0.1)
    assert (point.attempts, point.valid, point.load_measured_N) == (2, True, pytest.approx(LOAD, abs=0.1))


@pytest.mark.parametrize("glance", [False, True])
def test_an_open_bridge_stops_a_set_that_is_made_again_at_a_glance_before_its_dwell(
    first: Set, monkeypatch: pytest.MonkeyPatch, glance: bool
) -> None:
    first.work.servo.glance()
    open_bridge(first.sim, monkeypatch)
    with pytest.raises(DeviceError, match="no valid reading while driving: bridge open; outputs are off"):
        first.work.servo.glance() if glance else first.work.again(LOAD, "again", 0.1)
    assert outputs(first.sim) == OFF


# --- the approach --------------------------------------------------------------------------------------


def test_the_approach_reaches_the_force_in_a_third_of_the_time(sim: SimulatedBench, bench: Bench) -> None:
    bench.operator.mount(SAMPLES["2"])
    times = []
    for press in (preload, lambda *given: approach(*given, "it").force):
        bench.device("positioner").home()
        began = sim.clock.now_ns()
        assert (press(bench, THESIS_LOAD_CELL, PRELOAD), now(sim).mean()) == (
            pytest.approx(PRELOAD, rel=0.05),
            pytest.approx(PRELOAD, rel=0.1),
        )
        times.append(1e-9 * (sim.clock.now_ns() - began))
    assert times[1] < 8
    assert 2.8 * times[1] < times[0]


@pytest.fixture
def moves(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Positions to which the probe was sent [m]."""
    sent: list[float] = []
    positioner = bench.device("positioner")
    move = positioner.move
    monkeypatch.setattr(positioner, "move", lambda target, speed: (sent.append(target), move(target, speed)))
    return sent


def test_no_step_is_longer_than_a_slow_one_and_what_is_known_to_be_free_is_crossed_in_one_move_but_for_one_step(
    bench: Bench, moves: list[float]
) -> None:
    bench.operator.mount(SAMPLES["1"])
    first = approach(bench, THESIS_LOAD_CELL, PRELOAD, "it")
    assert np.abs(np.diff([0.0, *moves])).max() <= APPROACH_STEP * (1 + 1e-12)
    assert 0 < first.free < first.position
    bench.device("positioner").home()
    before = len(moves)
    again = approach(bench, THESIS_LOAD_CELL, PRELOAD, "it", free_until=first.free)
    assert moves[before] == pytest.approx(first.free - APPROACH_STEP)
    assert len(moves) - before < before
    assert again.force == pytest.approx(PRELOAD, rel=0.05)


@pytest.mark.parametrize("known", [0.0, 16e-3])  # what is said to be free is not
def test_a_force_above_the_limit_sends_the_probe_home(sim: SimulatedBench, known: float) -> None:
    with limited(sim, 0.8) as bench:
        bench.operator.mount(SAMPLES["1"])
        with pytest.raises(SafetyError, match=r"passes the bench's force limit of 0\.8 N"):
            approach(bench, THESIS_LOAD_CELL, PRELOAD, "it", free_until=known)
        assert bench.device("positioner").position() == 0.0
    assert now(sim).max() == 0.0
