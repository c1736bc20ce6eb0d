"""A drive without a sine of its own: the bus streams set-points to it, and it is off soon after this program dies."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest

from palpate.drivers.devices.exciter import FEWEST, Exciter, SetPointGrid, grid
from palpate.drivers.links.can import CanLink, Cyclic
from palpate.drivers.ownership import claim
from palpate.drivers.safe_end import insist
from palpate.instrument.contracts.declaration import MOST_CYCLIC
from palpate.instrument.errors import BenchInUse, DeviceError, LinkError, RangeError, SafetyError
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from tests.drivers.benches import open_bench
from tests.shares import first_of

SCENE = read_scene("ideal").with_devices({"drive": {"kind": "maxon-epos4", "full_scale": 0.5}})
WATCHDOG = 2.0  # s, of every bench file that says nothing else
PERCENT = 5.0 * 3.5 / 100  # V at the coil for a percent of the rated torque


@pytest.fixture(scope="module")
def sim() -> Iterator[SimulatedBench]:
    with SimulatedBench(SCENE) as simulated:
        yield simulated


def volts(sim: SimulatedBench) -> float:
    """Peak of the sine at the coil [V]."""
    return float(abs(sim.rig.coil_voltage().amplitude[0]))


@contextmanager
def driven(sim: SimulatedBench, amplitude: float) -> Iterator[tuple[Any, Any]]:
    """An open bench that drives at 10 Hz, and its exciter."""
    with open_bench(sim) as bench:
        bench.drive()
        drive = bench.role(Exciter)
        drive.sine(10.0, amplitude)
        yield bench, drive


# --- the stream ----------------------------------------------------------------------------------------


def test_a_sine_of_10_hz_at_1_khz_is_a_list_of_exactly_100_set_points() -> None:
    found = grid(10.0, 1e-3, "drive")
    assert found == SetPointGrid(100, 1000, 1)
    assert found.sine(2.0)[:2] == [0.0, pytest.approx(2.0 * math.sin(2 * math.pi / 100))]


@pytest.mark.parametrize("frequency", [0.1, 3.7, 15.0, 33.4, 40.0])
def test_the_list_of_a_frequency_has_whole_periods_of_it(frequency: float) -> None:
    found = grid(frequency, 1e-3, "drive")
    assert FEWEST * found.periods <= found.count <= MOST_CYCLIC
    assert found.step_us >= 1000
    assert found.frequency == pytest.approx(frequency, rel=2.01e-5)
    assert sum(found.sine(1.0)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("frequency", [50.1, 0.001, 200.0])
def test_a_frequency_that_no_list_reaches_is_refused(frequency: float) -> None:
    with pytest.raises(RangeError, match=rf"drive: frequency = {frequency:g} Hz is outside 0\.00391 to 50 Hz"):
        grid(frequency, 1e-3, "drive")


def test_a_stream_shakes_the_stack_with_its_amplitude_and_its_phase_goes_on(sim: SimulatedBench) -> None:
    with driven(sim, 1.0) as (bench, drive):
        begun = sim.clock.now_ns()
        assert (volts(sim), drive.effort()) == (pytest.approx(5.0 * PERCENT, rel=0.01), 5.0)
        bench.clock.wait(0.123)
        drive.sine(10.0, 4.0)
        assert (sim.clock.now_ns() - begun) % 100_000_000 == 0  # the new list begins where the old one crosses zero
        assert volts(sim) == pytest.approx(20.0 * PERCENT, rel=0.005)
        before = sim.rig.coil_voltage()
        assert np.angle(before.amplitude[0]) == pytest.approx(-math.pi / 2 - math.pi / 100)  # steps are late by half
        drive.sine(10.0, 0.0)
        assert volts(sim) == 0.0
    assert not sim.devices["drive"].driving


def test_an_amplitude_above_the_full_scale_is_refused_before_anything_is_sent(sim: SimulatedBench) -> None:
    with open_bench(sim) as bench:
        bench.drive()
        with pytest.raises(RangeError, match=r"amplitude = 10\.5 V is outside 0 to 10 V"):
            bench.role(Exciter).sine(10.0, 10.5)
        assert volts(sim) == 0.0


class Kernel:
    """Stands for a bus whose kernel sends cyclic frames."""

    def __init__(self) -> None:
        self.begun: list[tuple[list[bytes], float]] = []
        self.stopped = 0

    def send_periodic(self, messages: list[can.Message], period: float) -> Any:
        assert not any(each.is_extended_id for each in messages)
        self.begun.append(([bytes(each.data) for each in messages], period))
        return SimpleNamespace(stop=self._stop)

    def _stop(self) -> None:
        self.stopped += 1


def test_on_a_real_bus_the_kernel_sends_the_list_and_a_new_one_replaces_it() -> None:
    kernel: Any = Kernel()
    cyclic = Cyclic(kernel, "socketcan", "can0")
    cyclic.begin(0x401, [b"\x01\x00", b"\xff\xff"], 1000)
    cyclic.begin(0x401, [b"\x02\x00", b"\xfe\xff"], 500)
    assert kernel.begun == [([b"\x01\x00", b"\xff\xff"], 1e-3), ([b"\x02\x00", b"\xfe\xff"], 5e-4)]
    assert kernel.stopped == 1
    cyclic.end_all()
    assert kernel.stopped == 2


def test_an_interface_without_a_timer_of_the_kernel_is_refused_by_name() -> None:
    bus: Any = None
    with pytest.raises(LinkError, match=r"CAN bus can7: pcan cannot send set-points on time.* use an adapter"):
        Cyclic(bus, "pcan", "can7").begin(0x401, [b"\0\0"], 1000)


# --- who dies ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("after", "amplitude"), first_of([(3.21, 2.0), (0.0, 10.0), (0.4567, 0.05), (29.9, 5.0)]))
def test_whoever_dies_at_any_moment_the_output_is_off_within_the_time_out(
    after: float, amplitude: float, sim: SimulatedBench
) -> None:
    with driven(sim, amplitude) as (bench, _):
        bench.clock.wait(after)
        assert sim.devices["drive"].driving
        sim.clock.wait(WATCHDOG)  # nobody feeds: the program is dead, and the kernel or the bus goes on with its list
        assert not sim.devices["drive"].driving
        assert volts(sim) == 0.0


@contextmanager
def another(sim: SimulatedBench) -> Iterator[Any]:
    """The driver of another program, which uses the drive and does not hold the lock of the bench."""
    described = sim.description.devices
    driver: Any = open_bench(sim).device("drive")
    driver.link.open()
    try:
        driver.connect()
        driver.set_up(described[0].settings, WATCHDOG)
        yield driver
    finally:
        driver.link.close()


def test_a_drive_that_another_program_has_stopped_on_the_bus_is_switched_off_at_once(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with driven(sim, 2.0) as (bench, drive):
        link: Any = bench.device("drive").link
        told: list[str] = []

        def command(node: Any, state: str) -> None:
            CanLink.command(link, node, state)
            told.append(state)

        def transfer(who: str, *_: Any) -> Any:
            if told[-1] == "STOPPED":  # instead of waiting for its answer in vain
                raise LinkError(f"{who}: no answer")
            return CanLink.transfer(link, who, *_)

        monkeypatch.setattr(link, "transfer", transfer)
        monkeypatch.setattr(link, "command", command)
        link.command(link.add_node(sim.devices["drive"].id), "STOPPED")
        with pytest.raises(LinkError, match="no answer"):
            drive.check()
        assert sim.devices["drive"].driving
        assert insist(drive.means(), bench.clock) == []
        assert not sim.devices["drive"].driving


def test_a_drive_that_another_program_has_made_deaf_to_set_points_hears_the_next_ones(sim: SimulatedBench) -> None:
    with driven(sim, 2.0) as (bench, drive):
        link: Any = bench.device("drive").link
        link.command(link.add_node(sim.devices["drive"].id), "PRE-OPERATIONAL")
        drive.check()  # an answer comes after what was sent before
        assert volts(sim) == 0.0
        drive.sine(10.0, 2.0)
        assert volts(sim) == pytest.approx(10.0 * PERCENT, rel=0.01)


def test_a_program_that_finds_the_drive_of_a_killed_one_waits_until_it_is_off(sim: SimulatedBench) -> None:
    with another(sim) as killed:
        killed.drive()
        killed.sine(10.0, 2.0)
        assert volts(sim) > 0.0
        with open_bench(sim) as bench:
            assert not sim.devices["drive"].driving
            bench.drive()  # which clears the fault that the master was lost
            bench.role(Exciter).sine(10.0, 1.0)
            assert volts(sim) == pytest.approx(5.0 * PERCENT, rel=0.01)


def test_a_drive_that_a_living_program_feeds_is_not_taken(sim: SimulatedBench) -> None:
    with another(sim) as first:
        first.drive()
    with another(sim) as second:

        def wait(duration: float) -> None:
            sim.clock.wait(duration)
            second.link.beat(127)  # what the first program does

        told: list[str] = []
        clock: Any = SimpleNamespace(wait=wait)
        with pytest.raises(BenchInUse, match="belongs to another program, which feeds its watchdog"):
            claim(second, clock, told.append)
        assert len(told) == 1
        second.rest()


def test_a_drive_that_watches_nobody_is_not_taken(sim: SimulatedBench) -> None:
    with another(sim) as first:
        first.drive()
        first.set("watchdog", 0.0)
    with another(sim) as second:
        with pytest.raises(DeviceError, match="is switched on, and watches nobody's heartbeat"):
            second.claim()
        second.rest()


def test_a_fault_stops_a_run_by_name_and_is_not_cleared(sim: SimulatedBench) -> None:
    with open_bench(sim) as bench:
        bench.drive()
        sim.devices["drive"].trip("over_current")
        with pytest.raises(SafetyError, match="has the fault 0x2310, and has switched its output off"):
            bench.role(Exciter).check()
        bench.rest()
        with pytest.raises(DeviceError, match="has the fault 0x2310; find its cause"):
            bench.drive()
    sim.devices["drive"].reset()


def test_a_drive_that_was_switched_off_and_on_has_its_set_up_again_and_gives_no_torque_before_it_is_asked(
    sim: SimulatedBench,
) -> None:
    with driven(sim, 1.0) as (bench, drive):
        sim.can.reboot(sim.devices["drive"])
        assert volts(sim) == 0.0
        with pytest.raises(SafetyError, match="its output was switched off"):
            drive.check()
        bench.recover()
        assert volts(sim) == 0.0
        bench.drive()
        drive.sine(10.0, 1.0)
        assert volts(sim) == pytest.approx(5.0 * PERCENT, rel=0.01)
