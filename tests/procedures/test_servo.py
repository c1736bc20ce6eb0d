"""A load is brought to where it should be, slowly or quickly, and the shaker stops where it should not be."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from palpate import Run
from palpate.drivers.devices import sensor_node
from palpate.drivers.devices.sensor_node import CanopenSensorNode, Recording, acquire
from palpate.extend import Bench, DynamicLoadWork, Floats, Lab, Recorder, StaticLoadWork
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.errors import BenchError, DeviceError, PalpateError, SafetyError, SettingsLost, UnreachableError
from palpate.instrument.sensor.designs import DESIGNS
from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.console.terminal import Progress
from palpate.procedures.steps.films import SHORT_RECORD
from palpate.procedures.steps.probe import APPROACH_STEP, approach, check_zero, preload
from palpate.procedures.steps.servo import PATIENCE, LoadServo
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import HEADER, OFF, Palpate, happens_in, outputs, sweep
from tests.shares import first_of

PRELOAD = 2.4  # N
MOMENTS = first_of(["servo", "settling", "dwell"])
SERVO_STEP = 1.0  # s at 10 Hz: 0.5 s of window and four readings


def mount(bench: Bench, sample: str = "2", force: float = PRELOAD) -> LoadServo:
    """A sample under the probe and the amplifier on, the amplitude still at zero."""
    bench.operator.mount(SAMPLES[sample])
    preloaded = preload(bench, THESIS_LOAD_CELL, force)
    bench.drive()
    return LoadServo(bench, THESIS_LOAD_CELL, 10.0, preloaded)


def stiffen(sim: SimulatedBench, factor: float = 100.0) -> None:
    """The stack becomes much stiffer: a part has come loose and jams."""
    rig = sim.rig
    found = rig.mounted.response
    assert found is not None
    rig.mounted = replace(rig.mounted, response=replace(found, stiffness=factor * found.stiffness))
    rig.set_position(rig.position)  # from now on


@contextmanager
def limited(sim: SimulatedBench, force_limit: float) -> Iterator[Bench]:
    description = sim.description.model_copy(update={"force_limit": force_limit})
    with Bench(description, sim.clock, sim.operator) as bench:
        yield bench


def during(
    monkeypatch: pytest.MonkeyPatch, sim: SimulatedBench, moment: str, step: str, action: Callable[[], object]
) -> Progress:
    """Does `action` in the middle of a moment of a load set ("servo", "settling" or "dwell"); hears of progress."""
    delay = {"servo": 0.2, "settling": 1.1, "dwell": 0.2}[moment]
    armed = False

    def acquired(nodes: Sequence[CanopenSensorNode], duration: float) -> list[Recording]:
        nonlocal armed
        if armed and moment == "dwell" and duration > SHORT_RECORD:
            armed = False
            happens_in(sim, delay, action)
        return acquire(nodes, duration)

    def progress(_done: int, _total: int, what: str) -> None:
        nonlocal armed
        if what == step and not seen:
            seen.append(what)
            armed = True
            if moment != "dwell":
                happens_in(sim, delay, action)

    seen: list[str] = []
    monkeypatch.setattr(sensor_node, "acquire", acquired)
    return progress


def open_bridge(sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on the indicator shows what it shows while a wire of the bridge is off."""
    read = sim.indicator.read
    sick = {"status": float(1 | 1 << 2), "reading": 0.0, "reading_float": math.nan}
    monkeypatch.setattr(sim.indicator, "read", lambda name: sick[name] if name in sick else read(name))


def now(sim: SimulatedBench) -> Floats:
    """Force on the load cell over the cycle that begins [N]."""
    return sim.rig.cell_force(sim.clock.now_ns() + np.arange(0, 100_000_000, 500_000))


# --- preload -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sample", ["1", "2"])
def test_the_probe_is_pressed_on_with_the_preload(sim: SimulatedBench, bench: Bench, sample: str) -> None:
    bench.operator.mount(SAMPLES[sample])
    reached = preload(bench, THESIS_LOAD_CELL, PRELOAD)
    assert reached == pytest.approx(PRELOAD, rel=0.05)
    assert now(sim).mean() == pytest.approx(PRELOAD, rel=0.05, abs=0.05)


def quickly(bench: Bench, calibration: LoadCellCalibration, force: float) -> None:
    approach(bench, calibration, force, "it")


@pytest.mark.parametrize("press", [preload, quickly])
def test_a_preload_beyond_the_travel_is_refused(bench: Bench, press: Callable[..., object]) -> None:
    bench.operator.mount(SAMPLES["2"])
    bench.device("positioner").set_limits(0.0, 10e-3)
    with pytest.raises(UnreachableError, match=r"preload of 2\.4 N is not reached: .* ends at 10\.000 mm"):
        press(bench, THESIS_LOAD_CELL, PRELOAD)


def test_a_preload_above_the_force_limit_sends_the_probe_home(sim: SimulatedBench) -> None:
    with limited(sim, 1.0) as bench:
        bench.operator.mount(SAMPLES["1"])
        with pytest.raises(SafetyError, match=r"passes the bench's force limit of 1 N"):
            preload(bench, THESIS_LOAD_CELL, PRELOAD)
        assert bench.device("positioner").position() == 0.0
    assert now(sim).max() == 0.0


@pytest.mark.parametrize("press", [preload, quickly])
def test_an_open_bridge_ends_the_approach_and_gives_no_steady_force(
    sim: SimulatedBench, bench: Bench, monkeypatch: pytest.MonkeyPatch, press: Callable[..., object]
) -> None:
    work = StaticLoadWork(Lab(bench, DESIGNS["single"], THESIS_LOAD_CELL), "1", PRELOAD)
    bench.operator.mount(SAMPLES["1"])
    open_bridge(sim, monkeypatch)
    with pytest.raises(DeviceError, match=r"no valid reading at 2\.\d+ mm: bridge open; check the bridge"):
        press(bench, THESIS_LOAD_CELL, PRELOAD)
    with pytest.raises(DeviceError, match="no valid reading under load: bridge open"):
        work.load()


# --- a bench that is later than its filters say, as a served one is on a busy machine ---------------------


def unstable(sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch, readings: int) -> list[int]:
    """The indicator calls so many further readings unstable; returns when it was asked."""
    asked: list[int] = []
    read, stable = sim.indicator.read, 1 << sim.indicator.contract["status"].bits["stable"]

    def late(name: str) -> float:
        if name != "status":
            return read(name)
        asked.append(sim.clock.now_ns())
        return float(int(read(name)) & ~(0 if len(asked) > readings else stable))

    monkeypatch.setattr(sim.indicator, "read", late)
    return asked


@pytest.mark.slow
def test_a_reading_that_is_not_stable_yet_is_waited_for_and_one_that_never_is_is_not_used(
    sim: SimulatedBench, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    servo = mount(bench)
    unstable(sim, monkeypatch, PATIENCE)
    assert servo.set(2.0) == pytest.approx(2.0, rel=0.05)
    unstable(sim, monkeypatch, 10 * PATIENCE)
    with pytest.raises(DeviceError, match="no valid reading while driving: not stable; outputs are off"):
        servo.set(2.0)
    assert outputs(sim) == OFF


def test_a_load_that_still_changes_is_laid_to_the_device_that_has_lost_its_settings(
    sim: SimulatedBench, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    servo = mount(bench)
    servo.set(2.0)
    asked = unstable(sim, monkeypatch, 10 * PATIENCE)
    sim.generator.write({"output": 0.0})
    with pytest.raises(SettingsLost, match=r"signal generator .* output"):
        servo.set(2.0)
    assert len(asked) == 1


def test_too_much_force_is_not_waited_out_while_the_reading_is_unstable(
    sim: SimulatedBench, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    servo = mount(bench)
    servo.set(2.0)
    stiffen(sim)
    asked = unstable(sim, monkeypatch, 10 * PATIENCE)
    with pytest.raises(SafetyError, match="passes the bench's limit"):
        servo.set(4.0)
    assert outputs(sim) == OFF
    assert len(asked) <= 3


# --- the dynamic load ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("sample", ["1", "2"])
def test_each_load_is_reached_in_a_few_steps(sim: SimulatedBench, bench: Bench, sample: str) -> None:
    servo = mount(bench, sample)
    began = sim.clock.now_ns()
    for load in (1.5, 4.0, 2.0):
        assert servo.set(load) == pytest.approx(load, abs=0.06)  # N, 0.6 steps of the indicator
        assert np.ptp(now(sim)) == pytest.approx(load, abs=0.12)
    assert sim.clock.now_ns() - began < 9 * SERVO_STEP * 1e9


@pytest.mark.parametrize(
    ("gain", "limit", "message"),
    [
        (2.0, 1.0, r"4 N peak .* needs .* A from the exciter, above 95 % of its limit of 1 A"),
        (0.5, 5.0, r"needs 1\d(\.\d)? V from the exciter, which gives 10 V"),
    ],
)
def test_a_load_beyond_the_current_limit_or_the_generators_amplitude_is_refused_before_the_amplifier_trips(
    bench: Bench, gain: float, limit: float, message: str
) -> None:
    mount(bench)
    bench.device("shaker_amplifier").configure(gain, limit, bench.description.watchdog)
    with pytest.raises(UnreachableError, match=message):
        LoadServo(bench, THESIS_LOAD_CELL, 10.0, PRELOAD).set(4.0)
    assert bench.device("shaker_amplifier").read().faults_latched == frozenset()


def test_where_no_load_appears_the_amplitude_does_not_grow_for_ever(sim: SimulatedBench, bench: Bench) -> None:
    servo = mount(bench)
    bench.device("shaker_amplifier").disable()
    with pytest.raises(UnreachableError, match=r"no load appears at 6\.75 V from the exciter"):
        servo.set(2.0)


# --- over-force ----------------------------------------------------------------------------------------


HAPPENINGS: dict[str, tuple[Callable[[SimulatedBench, pytest.MonkeyPatch], object], str, str]] = {
    "stiffens": (lambda sim, _: stiffen(sim), "SafetyError", r"force of .* N passes the bench's limit of 5 N; outputs"),
    "trips": (lambda sim, _: sim.amplifier.trip("over_temperature"), "SafetyError", "tripped on over_temperature; the"),
    "opens": (open_bridge, "DeviceError", "no valid reading while driving: bridge open; outputs are off"),
}


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("what", HAPPENINGS)
def test_a_stack_that_stiffens_an_amplifier_that_trips_and_an_open_bridge_stop_the_run_within_a_servo_step(
    sim: SimulatedBench, tmp_path: Path, what: str, moment: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    action, error, message = HAPPENINGS[what]
    happened: list[int] = []
    off: list[int] = []
    write = sim.amplifier.write

    def watched(values: dict[str, float]) -> None:
        if values.get("enable") == 0.0 and happened:
            off.append(sim.clock.now_ns())
        write(values)

    def happen() -> None:
        happened.append(sim.clock.now_ns())
        action(sim, monkeypatch)

    monkeypatch.setattr(sim.amplifier, "write", watched)
    progress = during(monkeypatch, sim, moment, "sample 2, 4 N", happen)
    with pytest.raises(PalpateError, match=message), limited(sim, 5.0) as bench:
        sweep(bench, tmp_path / "run", samples=("2",), loads=(2.0, 4.0), progress=progress)
    # Within a dwell the reading tells at its end.
    assert off[0] - happened[0] <= (SERVO_STEP + 1.0 * (moment == "dwell" and what != "trips")) * 1e9
    assert outputs(sim) == OFF
    run = Run.open(tmp_path / "run")
    assert (run.status, [p["load_N"] for p in run.points()]) == ("failed", [2.0])
    assert run.events()[-1]["message"].startswith(f"{error}: ")


@pytest.mark.slow
def test_a_load_that_drifts_off_during_the_dwell_is_set_anew_and_the_point_repeated(
    sim: SimulatedBench, bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    progress = during(monkeypatch, sim, "dwell", "sample 2, 3 N", lambda: stiffen(sim, 1.3))
    result = sweep(bench, tmp_path / "run", samples=("2",), loads=(2.0, 3.0), progress=progress)
    assert [(p.attempts, p.flags, p.valid) for p in result.points] == [(1, (), True), (2, (), True)]
    assert result.points[1].load_measured_N == pytest.approx(3.0, abs=0.12)
    (rejected,) = Run.open(tmp_path / "run").events()
    assert (rejected["kind"], rejected["message"]) == ("rejected", "sample 2, 3 N, attempt 1: drifted")


def test_an_output_that_vanishes_never_gives_a_point(
    sim: SimulatedBench, bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_the_front_panel = {"output": 0.0}
    progress = during(monkeypatch, sim, "dwell", "sample 1, 3 N", lambda: sim.generator.write(at_the_front_panel))
    with pytest.raises(PalpateError):
        sweep(bench, tmp_path / "run", samples=("1",), loads=(2.0, 3.0, 4.0), progress=progress)
    run = Run.open(tmp_path / "run")
    assert [(p["load_N"], p["valid"]) for p in run.points()] == [(2.0, True)]
    assert run.events()[0]["message"] == "sample 1, 3 N, attempt 1: drifted"


# --- what a sweep looks at before it drives, and what it leaves alone ---------------------------------

SMALL = ("sweep", "loads", "--samples", "2", "--loads", "2 N")


def test_a_tare_that_somebody_left_is_cleared(bench: Bench) -> None:
    indicator = bench.device("strain_indicator")
    indicator.track(0.1)
    for weight in (0.2, 0.0):
        bench.operator.place_weight(weight)
        bench.clock.wait(1.0)
        if weight:
            indicator.command("tare")
    assert indicator.read().reading_mV < -15
    check_zero(bench, THESIS_LOAD_CELL)
    assert indicator.read().reading_mV == pytest.approx(1.8, abs=1.5)


def test_a_weight_left_on_the_cell_stops_the_sweep_before_it_drives(bench: Bench, sim: SimulatedBench) -> None:
    bench.operator.place_weight(0.05)
    with pytest.raises(BenchError, match=r"without load.*thesis Table 5\.1.*take the load off"):
        check_zero(bench, THESIS_LOAD_CELL)
    assert not sim.amplifier.settings["enable"]


@pytest.mark.parametrize(
    ("zero", "told"),
    [
        ({}, r"says 20 ± 3\.1 mV"),
        ({"zero_u": 0.05, "resolution_mV": 0.01, "scatter_mV": 0.3}, r"says 20 ± 0\.48 mV"),
    ],
)
def test_a_calibration_of_another_zero_is_not_used_where_it_differs_by_more_than_readings_scatter(
    bench: Bench, zero: dict[str, float], told: str
) -> None:
    """Else one run in five on an indicator with steps of 0.01 mV stops: its mean of four readings scatters by more."""
    with pytest.raises(BenchError, match=told):
        check_zero(bench, THESIS_LOAD_CELL.model_copy(update={"zero_mV": 20.0, **zero}))


@pytest.mark.slow
def test_the_scene_kept_with_a_run_gives_that_run_again(palpate: Palpate) -> None:
    first = palpate(*SMALL, "--seed", "7", "--model", "column", "--out", "first", "--json").object
    again = palpate(*SMALL, "--scene", "first/scene.toml", "--out", "again", "--json").object
    assert (again["seed"], again["model"], again["points"]) == (7, "column", first["points"])
    assert Run.open(Path("again")).digest() == Run.open(Path("first")).digest()


def test_a_real_bench_does_not_sweep_on_the_thesis_calibration(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Bench, "simulated", False)
    spoken = palpate(*SMALL)
    assert spoken.status == 2
    assert "has no calibration; run palpate calibrate load-cell" in spoken.complaint


# --- Bench time saved where only the ratio is sought: a quick approach, and load sets at a know --------


LOAD, LIGHT = 2.0, 1.2  # N


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
        work.hold(approach(bench, THESIS_LOAD_CELL, LIGHT, "sample 1").force)
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
    first.work.lab.bench.force_limit = LIGHT + LOAD
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
        assert (press(bench, THESIS_LOAD_CELL, LIGHT), now(sim).mean()) == (
            pytest.approx(LIGHT, rel=0.05),
            pytest.approx(LIGHT, rel=0.1),
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
    first = approach(bench, THESIS_LOAD_CELL, LIGHT, "it")
    assert np.abs(np.diff([0.0, *moves])).max() <= APPROACH_STEP * (1 + 1e-12)
    assert 0 < first.free < first.position
    bench.device("positioner").home()
    before = len(moves)
    again = approach(bench, THESIS_LOAD_CELL, LIGHT, "it", free_until=first.free)
    assert moves[before] == pytest.approx(first.free - APPROACH_STEP)
    assert len(moves) - before < before
    assert again.force == pytest.approx(LIGHT, rel=0.05)


@pytest.mark.parametrize("known", [0.0, 16e-3])  # what is said to be free is not
def test_a_force_above_the_limit_sends_the_probe_home(sim: SimulatedBench, known: float) -> None:
    with limited(sim, 0.8) as bench:
        bench.operator.mount(SAMPLES["1"])
        with pytest.raises(SafetyError, match=r"passes the bench's force limit of 0\.8 N"):
            approach(bench, THESIS_LOAD_CELL, LIGHT, "it", free_until=known)
        assert bench.device("positioner").position() == 0.0
    assert now(sim).max() == 0.0
