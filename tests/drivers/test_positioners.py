"""Positioners, our own and those of makers, go where they are sent, within their limits, and say when they do not."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.positioner import MicroPositioner
from palpate.extend import Bench, ModbusDevice, SimulatedDevice, read_scene
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.bench.role_maps import PositionerMap
from palpate.instrument.config import check
from palpate.instrument.contracts import maps
from palpate.instrument.contracts.own import POSITIONER
from palpate.instrument.errors import ConfigError, DeviceError, RangeError
from palpate.procedures.testing.wire import listen
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.positioner import HOMING_SPEED, Axis
from palpate.simulators.guests import guests
from palpate.testing import RtuConformance
from tests.drivers.fake_links import Registers
from tests.procedures.conftest import happens_in
from tests.shares import first_of


class TestPositioner(RtuConformance):
    @staticmethod
    def ends(bench: Bench, sim: SimulatedBench) -> tuple[ModbusDevice, SimulatedDevice]:
        return bench.device("positioner"), sim.positioner


def test_a_move_takes_its_time_and_ends_at_the_target(bench: Bench, sim: SimulatedBench) -> None:
    positioner = bench.device("positioner")
    before = sim.clock.now_ns()
    positioner.set(target=0.01, speed=2e-3, command="move")
    sim.clock.wait(2.5)
    assert positioner.position() == 0.005
    assert positioner.contract.set_bits("status", positioner.get("status")) == {"moving", "homed"}
    assert sim.rig.position == 0.0  # the scene follows when the move has ended
    sim.clock.wait(2.5)
    assert positioner.contract.set_bits("status", positioner.get("status")) == {"homed"}
    assert (positioner.position(), sim.rig.position) == (0.01, 0.01)
    positioner.move(0.004, speed=1e-3)
    assert sim.clock.now_ns() - before == 11_000_000_000
    positioner.home()
    assert positioner.position() == 0.0


@pytest.mark.parametrize("start", [0.00005, 0.0137, 0.025])
def test_homing_is_noticed_within_a_poll_of_its_end_by_few_requests(
    start: float, bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.device("positioner").move(start, speed=5e-3)
    wire = listen(bench.device("positioner").link, monkeypatch)
    before = sim.clock.now_ns()
    bench.device("positioner").home()
    late = 1e-9 * (sim.clock.now_ns() - before) - start / HOMING_SPEED
    assert 0 <= late < 0.1
    assert len(wire.requests) <= 14  # of which each second look is two


def test_a_move_stops_where_it_is(bench: Bench, sim: SimulatedBench) -> None:
    bench.device("positioner").set(target=0.01, speed=1e-3, command="move")
    sim.clock.wait(3.0)
    bench.device("positioner").stop()
    sim.clock.wait(10.0)
    assert (bench.device("positioner").position(), sim.rig.position) == (0.003, 0.003)
    assert bench.device("positioner").get("status") == 2


def test_a_move_that_takes_too_long_is_stopped_when_its_time_is_over(bench: Bench, sim: SimulatedBench) -> None:
    before = sim.clock.now_ns()
    with pytest.raises(DeviceError, match="not at 20 mm after 5 s; it was stopped"):
        bench.device("positioner").move(0.02, speed=1e-3, timeout=5.0)
    assert sim.clock.now_ns() - before <= 5_200_000_000
    sim.clock.wait(20.0)
    assert bench.device("positioner").position() == pytest.approx(0.005, abs=2e-4)


@pytest.mark.parametrize("target", [-1e-6, 0.025001, math.nan])
def test_a_target_beyond_the_limits_and_limits_the_wrong_way_round_are_refused_before_anything_is_sent(
    target: float, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    positioner = bench.device("positioner")
    wire = listen(positioner.link, monkeypatch)
    with pytest.raises(RangeError, match=r"micro-positioner: target .* outside its limits 0 to 25 mm"):
        positioner.move(target)
    with pytest.raises(RangeError, match="lower limit 4 mm is not at or below the upper limit 2 mm"):
        positioner.set_limits(0.004, 0.002)
    assert wire.requests == []


@pytest.mark.parametrize("limit", first_of([0.000019, 0.025, 0.0123, 0.007007]))
def test_the_limit_itself_can_be_reached_by_whoever_reads_it(limit: float, bench: Bench) -> None:
    bench.device("positioner").set_limits(0.0, limit)
    bench.device("positioner").connect()
    assert bench.device("positioner").travel() == limit
    bench.device("positioner").move(limit, speed=5e-3)
    assert bench.device("positioner").contract.set_bits("status", bench.device("positioner").get("status")) == {
        "homed",
        "at_limit",
    }


def test_the_positioner_itself_refuses_to_leave_its_limits_and_limits_the_wrong_way_round(bench: Bench) -> None:
    positioner = bench.device("positioner")
    with pytest.raises(DeviceError, match="illegal value"):
        positioner.set(limit_low=0.004, limit_high=0.002)
    assert positioner.get_many("limit_low", "limit_high") == [0.0, 0.025]
    positioner.set_limits(0.002, 0.004)
    for target in (0.001999, 0.004001):
        with pytest.raises(DeviceError, match="answered exception 3, illegal value, to target = "):
            positioner.set(target=target, speed=1e-3, command="move")
        assert positioner.get("target") == 0.0
    assert positioner.contract.set_bits("status", positioner.get("status")) == {"homed"}


# --- the driver by itself ------------------------------------------------------------------------------


HOMED = 2


def positioner(**held: Any) -> tuple[MicroPositioner, Any, VirtualClock]:
    link: Any = Registers(POSITIONER, **{"limit_high": 0.02, "status": HOMED, **held})
    clock = VirtualClock()
    driver = MicroPositioner.at(DevicePlace(link, 1, None, clock))
    driver.connect()
    link.asked.clear()
    return driver, link, clock


@pytest.mark.parametrize(("off", "there"), [(0.0, True), (1e-6, True), (3e-6, False), (-3e-6, False)])
def test_a_positioner_stands_where_it_was_sent_to_two_micrometres(off: float, there: bool) -> None:
    driver, link, _ = positioner()
    link.written = lambda: link.put(position=0.005 + off)
    if not there:
        with pytest.raises(DeviceError, match=r"stands at .* mm, was sent to 5 mm$"):
            driver.move(0.005)
        return
    driver.move(0.005)
    assert driver.differences() == []
    link.put(position=0.005 + 3e-6)
    assert driver.differences() == ["micro-positioner at rack unit 1: stands at 5.003 mm, was sent to 5 mm"]
    link.put(position=0.005, status=0)
    assert driver.differences() == ["micro-positioner at rack unit 1: has lost its home"]


def test_the_limits_of_a_bench_that_were_set_before_are_kept_when_it_is_opened_again() -> None:
    driver, link, _ = positioner()
    assert driver.travel() == 0.02
    driver.set_limits(0.001, 0.01)
    link.put(limit_low=0.0, limit_high=0.02)
    driver.connect()
    assert (driver.travel(), len(driver.differences())) == (0.01, 2)


# --- positioners of makers -----------------------------------------------------------------------------


LEAD = 1e-3  # m of the screw
STEPS = {  # of a turn
    "oriental-motor-blvd-krd": 36_000,
    "oriental-motor-blvd-krd-can": 36_000,
    "nanotec-c5-e": 2_000,
    "leadshine-cs2rs": 10_000,
}
KRD, KRD_CAN, C5, CS2RS = STEPS
ALL = [pytest.param(kind, marks=[pytest.mark.slow] * (kind in (KRD_CAN, CS2RS))) for kind in STEPS]


@contextmanager
def served(kind: str, **section: Any) -> Iterator[tuple[SimulatedBench, Any]]:
    """A simulated bench on which such a device moves the probe, and its twin."""
    table = {"kind": kind, "role": "positioner", "metres_per_step": LEAD / STEPS[kind], "travel": "25 mm", **section}
    with SimulatedBench(replace(read_scene("ideal"), devices=guests({"stage": table}, "scene"))) as sim:
        yield sim, sim.devices["stage"]


@contextmanager
def opened(kind: str, **section: Any) -> Iterator[tuple[SimulatedBench, Any, Any]]:
    """The same, with its driver on the open bench."""
    with served(kind, **section) as (sim, twin), Bench(sim.description, sim.clock, sim.operator) as bench:
        yield sim, twin, bench.device("stage")


# by hand: 2 mm at 1 mm/s and 20 mm/s², with a screw of 1 mm: 2 turns at 60 r/min; 20 turns/s² are 1200 r/min/s, so that
# it is at speed after 50 ms, and would be at 1000 r/min after 833 ms
WRITTEN: dict[str, dict[str, float]] = {
    KRD: {"operation": 1, "target": 72_000, "speed": 60, "acceleration": 50, "deceleration": 50, "torque": 50},
    KRD_CAN: {"target": 72_000, "speed": 60, "acceleration": 1200, "deceleration": 1200, "max_torque": 50, "mode": 1},
    C5: {"target": 4_000, "speed": 60, "acceleration": 1200, "deceleration": 1200, "max_torque": 50, "mode": 1},
    CS2RS: {"path_mode": 1, "target": 20_000, "speed": 60, "acceleration": 833, "deceleration": 833, "pause": 0},
}


@pytest.mark.parametrize("kind", ALL)
def test_a_move_takes_the_time_of_its_speed_and_acceleration_and_moves_the_probe(kind: str) -> None:
    with opened(kind) as (sim, twin, stage):
        stage.home()
        begun = sim.clock.now_ns()
        stage.move(2e-3, 1e-3)
        assert {name: round(twin.settings[name]) for name in WRITTEN[kind]} == WRITTEN[kind]
        assert 1e-9 * (sim.clock.now_ns() - begun) == pytest.approx(2.05, abs=0.05)
        assert (sim.rig.position, stage.position()) == (pytest.approx(2e-3), pytest.approx(2e-3))
        high = round(25e-3 / LEAD * STEPS[kind])
        assert (twin.settings["limit_low"], twin.settings["limit_high"]) == (0, high)
        assert stage.differences() == []
        stage.home()
        assert sim.rig.position == 0.0


@pytest.mark.slow
def test_steps_may_count_upwards() -> None:
    with opened(C5, metres_per_step=-5e-7) as (sim, twin, stage):
        stage.home()
        stage.move(1e-3)
        assert (twin.settings["target"], sim.rig.position) == (-2000, pytest.approx(1e-3))
        assert (twin.settings["limit_low"], twin.settings["limit_high"]) == (-50_000, 0)


@pytest.mark.parametrize(
    ("kind", "field", "value", "said"),
    [
        (KRD, "failed_requests", 0.0, "failed_requests is normal, must be exception"),
        pytest.param(KRD, "timeout", 500.0, "timeout is 500, must be 0", marks=pytest.mark.slow),
        pytest.param(KRD, "trigger_clears", 0.0, "trigger_clears is no, must be yes", marks=pytest.mark.slow),
        pytest.param(C5, "homing_method", 35.0, "homing_method is 35, must be 17 or 18 or", marks=pytest.mark.slow),
        pytest.param(C5, "steps_per_turn", 0.0, "steps_per_turn is 0; set the steps", marks=pytest.mark.slow),
    ],
)
def test_a_setting_that_hides_failures_or_is_dangerous_is_refused_when_the_bench_is_opened(
    kind: str, field: str, value: float, said: str
) -> None:
    with served(kind) as (sim, twin):
        twin.settings[field] = value
        with pytest.raises(DeviceError, match=said), Bench(sim.description, sim.clock, sim.operator):
            pass


def test_what_it_cannot_do_is_refused_before_anything_moves() -> None:
    with opened(C5) as (sim, twin, stage):
        with pytest.raises(DeviceError, match="has lost its home; move it home first"):
            stage.move(1e-3)
        stage.home()
        for target, speed in ((25.1e-3, 1e-3), (-1e-6, 1e-3), (1e-3, 0.0), (1e-3, -1.0), (1e-3, 1e-6), (1e-3, 1e6)):
            with pytest.raises(RangeError, match=r"outside|does not fit|give one above 0|give more"):
                stage.move(target, speed)
        assert (twin.settings["target"], sim.rig.position) == (0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [KRD, KRD_CAN])
def test_an_interrupt_in_a_move_stops_the_motor(kind: str) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    with opened(kind) as (sim, _, stage):
        stage.home()
        happens_in(sim, 1.0, interrupt)
        with pytest.raises(KeyboardInterrupt):
            stage.move(10e-3)
        assert stage.position() == pytest.approx(1e-3, abs=1e-4)
        sim.clock.wait(20.0)
        assert stage.position() == pytest.approx(1e-3, abs=1e-4)
        assert not [each for each in stage.differences() if "alarm" in each]
        stage.move(2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [KRD, C5, CS2RS])
def test_after_a_power_cycle_settings_return_and_a_home_that_was_lost_is_looked_for(kind: str) -> None:
    with opened(kind) as (sim, twin, stage):
        stage.home()
        stage.move(2e-3)
        twin.reset()
        assert any("has lost its home" in each for each in stage.differences()) == (kind != KRD)
        stage.restore()
        if kind == KRD:  # its encoder is absolute
            stage.move(3e-3)
        else:
            with pytest.raises(DeviceError, match="has lost its home"):
                stage.move(3e-3)
        stage.home()
        assert sim.rig.position == pytest.approx(0.0, abs=1e-9)
        stage.move(1e-3)
        assert sim.rig.position == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"target": "nothing"}, "target: 'nothing' is no field that can be written; valid: operation, target"),
        ({"position": "reset"}, "position: 'reset' is no field that can be read"),
        ({"enable": "go"}, "'go' is no command; valid: enable, stop"),
        ({"speed": "acceleration"}, "acceleration: its unit is 'ms'; valid: step/s, r/min"),
        ({"with_target": {"trigger": "start"}}, "with_target: operation is written with the target; give its value"),
    ],
)
def test_a_table_that_its_map_does_not_bear_out_is_refused(change: dict[str, Any], said: str) -> None:
    kind = device_kind(KRD)
    assert kind.map is not None
    table = check({**kind.map.roles["positioner"], **change}, PositionerMap, "map")
    assert any(each.startswith(said) for each in table.wrong(kind.contract))


def test_a_table_with_two_watches_or_half_a_watch_is_refused() -> None:
    kind = device_kind(KRD)
    assert kind.map is not None
    for change, said in (
        ({"heartbeat": "timeout"}, "lifetime and heartbeat"),
        ({"idle": {}}, "needed with a lifetime"),
    ):
        with pytest.raises(ConfigError, match=said):
            check({**kind.map.roles["positioner"], **change}, PositionerMap, "map")


def test_an_axis_speeds_up_and_slows_down() -> None:
    axis = Axis()
    axis.go(0, -100.0, 10.0, 2.0, 2.5)  # 5 s and 25 steps up, 4 s and 20 steps down, 5.5 s between
    assert axis.ends_ns == pytest.approx(14.5e9)
    for time, position in ((0.0, 0.0), (2.0, -4.0), (5.0, -25.0), (7.0, -45.0), (10.5, -80.0), (12.5, -95.0)):
        assert axis.at(round(1e9 * time)) == pytest.approx(position)
    axis.stop(5_000_000_000)
    assert (axis.moving, axis.goal) == (False, -25.0)
    axis.go(0, -25.0, 10.0, 2.0, 2.5)
    assert not axis.moving
    axis.go(0, -21.0, 10.0, 1.0, 1.0)  # too short a way to reach the speed: half of it takes sqrt(2 · 2 / 1) s
    assert (axis.ends_ns, axis.at(2_000_000_000)) == (pytest.approx(4e9), pytest.approx(-23.0))


@pytest.mark.parametrize(("option", "state"), [(1, 0x40), (2, 0x40), (6, 0x07)])
def test_a_twin_ends_a_quick_stop_as_its_option_code_says(option: int, state: int) -> None:
    with served(C5) as (_, twin):
        written = {"quick_stop_reaction": [option], "controlword": [0x06, 0x07, 0x0F, 0x02]}
        for name, values in written.items():
            for value in values:
                twin.write(twin.contract[name], value)
        assert twin.read(twin.contract["statusword"]) & 0x6F == state


def test_a_twin_knows_the_objects_of_its_drive_whatever_a_map_calls_them(tmp_path: Path) -> None:
    shipped = (resources.files(maps) / f"{C5}.toml").read_text()
    renamed = re.sub(r"\b(mode|controlword|statusword)\b(?! of)", r"own_\1", shipped).replace(
        "mode_display", "mode_shown"
    )
    (tmp_path / "own.toml").write_text(renamed)
    table = {"map": str(tmp_path / "own.toml"), "role": "positioner", "metres_per_step": 5e-7, "travel": "25 mm"}
    scene = replace(read_scene("ideal"), devices=guests({"stage": table}, "scene"))
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        bench.device("stage").home()
        bench.device("stage").move(1e-3)
        assert sim.rig.position == pytest.approx(1e-3)
