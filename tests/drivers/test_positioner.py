"""The micro-positioner goes where it is sent, within its limits, and says when it does not."""

from __future__ import annotations

import math
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.devices.positioner import MicroPositioner
from palpate.instrument.contracts.own import POSITIONER
from palpate.instrument.errors import DeviceError, RangeError
from palpate.procedures.testing.wire import listen
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.positioner import HOMING_SPEED
from palpate.simulators.wire.device import SimulatedDevice
from palpate.testing import RtuConformance
from tests.drivers.registers import Registers
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
def test_a_target_beyond_the_limits_is_refused_before_anything_is_sent(
    target: float, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    wire = listen(bench.device("positioner").link, monkeypatch)
    with pytest.raises(RangeError, match=r"micro-positioner: target .* outside its limits 0 to 25 mm"):
        bench.device("positioner").move(target)
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


def test_the_positioner_itself_refuses_to_leave_its_limits(bench: Bench) -> None:
    positioner = bench.device("positioner")
    positioner.set_limits(0.002, 0.004)
    for target in (0.001999, 0.004001):
        with pytest.raises(DeviceError, match="answered exception 3, illegal value, to target = "):
            positioner.set(target=target, speed=1e-3, command="move")
        assert positioner.get("target") == 0.0
    assert positioner.contract.set_bits("status", positioner.get("status")) == {"homed"}


def test_limits_the_wrong_way_round_are_refused_before_anything_is_sent(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    wire = listen(bench.device("positioner").link, monkeypatch)
    with pytest.raises(RangeError, match="lower limit 4 mm is not at or below the upper limit 2 mm"):
        bench.device("positioner").set_limits(0.004, 0.002)
    assert wire.requests == []
    with pytest.raises(DeviceError, match="illegal value"):
        bench.device("positioner").set(limit_low=0.004, limit_high=0.002)
    assert bench.device("positioner").get_many("limit_low", "limit_high") == [0.0, 0.025]


# --- the driver by itself ------------------------------------------------------------------------------


HOMED = 2


def positioner(**held: Any) -> tuple[MicroPositioner, Any, VirtualClock]:
    link: Any = Registers(POSITIONER, **{"limit_high": 0.02, "status": HOMED, **held})
    clock = VirtualClock()
    driver = MicroPositioner.at(DevicePlace(link, 1, None, clock))
    driver.connect()
    link.asked.clear()
    return driver, link, clock


@pytest.mark.parametrize(
    ("status", "found"), [(HOMED, []), (0, ["micro-positioner at rack unit 1: has lost its home"])]
)
def test_a_positioner_that_has_lost_its_home_differs(status: int, found: list[str]) -> None:
    driver, link, _ = positioner()
    link.put(status=status)
    assert driver.differences() == found


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


def test_the_limits_of_a_bench_that_were_set_before_are_kept_when_it_is_opened_again() -> None:
    driver, link, _ = positioner()
    assert driver.travel() == 0.02
    driver.set_limits(0.001, 0.01)
    link.put(limit_low=0.0, limit_high=0.02)
    driver.connect()
    assert driver.travel() == 0.01
    assert len(driver.differences()) == 2
