"""The strain indicator reads the load cell, and takes zero and tare by command and acknowledge."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.load_indicator import IndicatorReading, StrainIndicator
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.contracts.own import STRAIN_INDICATOR
from palpate.instrument.errors import DeviceError
from palpate.instrument.models.response import response
from palpate.instrument.sensor.sample import SAMPLES, Load
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.device import SimulatedDevice
from palpate.testing import RtuConformance
from tests.drivers.registers import Registers

GRAVITY = 9.80665  # m/s2
MILLIVOLT_PER_NEWTON = 10.306  # of Table 5.1


class TestStrainIndicator(RtuConformance):
    @staticmethod
    def ends(bench: Bench, sim: SimulatedBench) -> tuple[ModbusDevice, SimulatedDevice]:
        return bench.device("strain_indicator"), sim.indicator


def drive(bench: Bench, amplitude: float) -> None:
    bench.drive()
    bench.device("signal_generator").sine(10.0, amplitude)


@pytest.mark.parametrize(("mass", "reading"), [(0.0, 2), (0.14, 16), (0.44, 46), (0.74, 77)])
def test_a_weight_reads_as_in_table_5_1(mass: float, reading: int, bench: Bench) -> None:
    bench.operator.place_weight(mass)
    bench.clock.wait(2.0)
    shown = bench.device("strain_indicator").read()
    assert shown.reading_mV == pytest.approx(reading, abs=1)
    assert (shown.resolution_mV, shown.valid) == (1.0, True)


def ideal(scene: Scene) -> Scene:
    """The scene without its load cell's zero, noise and steps."""
    return replace(scene, effects={})


def test_zero_and_tare_are_taken_acknowledged_and_cleared(bench: Bench) -> None:
    indicator = bench.device("strain_indicator")
    bench.operator.place_weight(0.3)
    bench.clock.wait(2.0)
    gross = indicator.read().reading_mV
    indicator.command("zero")
    assert indicator.read().reading_mV == pytest.approx(0, abs=1)
    assert indicator.contract.choice("last_command", indicator.get("last_command")) == "zero"
    bench.operator.place_weight(0.5)
    bench.clock.wait(2.0)
    indicator.command("tare")
    assert indicator.contract.set_bits("status", indicator.get("status")) == {"stable", "net"}
    assert indicator.read().reading_mV == pytest.approx(0, abs=1)
    indicator.clear_tare()
    assert indicator.contract.set_bits("status", indicator.get("status")) == {"stable"}
    assert indicator.read().reading_mV == pytest.approx(0.2 * GRAVITY * MILLIVOLT_PER_NEWTON, abs=1.5)
    indicator.command("clear_zero")
    assert indicator.read().reading_mV == pytest.approx(gross + 0.2 * GRAVITY * MILLIVOLT_PER_NEWTON, abs=1.5)


def test_a_command_is_pending_until_it_is_carried_out_and_a_second_one_is_given_after_it(
    bench: Bench, sim: SimulatedBench
) -> None:
    indicator = bench.device("strain_indicator")
    bench.clock.wait(2.0)
    indicator.set(command="tare")
    assert indicator.get("command") == 3
    sim.clock.wait(0.049)
    assert indicator.get("command") == 3
    indicator.set(command="zero")  # which it answers with "busy" until the first is carried out
    assert indicator.get_many("command", "last_command", "command_result") == [1, 3, 1]
    sim.clock.wait(0.05)
    assert indicator.get_many("command", "last_command", "command_result") == [0, 1, 1]


def test_zero_and_tare_are_refused_while_the_reading_moves(bench: Bench) -> None:
    for command in ("zero", "tare"):
        bench.operator.place_weight(0.3)
        with pytest.raises(DeviceError, match=f"{command} ended in refused_unstable; wait for a stable"):
            bench.device("strain_indicator").command(command)
        bench.operator.place_weight(0.0)
        bench.device("strain_indicator").command("clear_zero")
        bench.device("strain_indicator").clear_tare()
    assert bench.device("strain_indicator").get("status") == 0


def test_a_command_is_carried_out_when_it_is_due_whether_anybody_looks_or_not(scene: Scene) -> None:
    with SimulatedBench(ideal(scene)) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        bench.device("strain_indicator").track(1.0)
        sim.clock.wait(10.0)
        bench.operator.place_weight(0.3)
        sim.clock.wait(7.0)
        bench.device("strain_indicator").set(command="tare")
        sim.clock.wait(0.95)
        final = 0.3 * GRAVITY * MILLIVOLT_PER_NEWTON
        missed = final * (math.exp(-7.05) - math.exp(-7.95))  # what the filter gained since the tare
        assert bench.device("strain_indicator").read().reading_mV == pytest.approx(missed, abs=1e-4)
        bench.operator.place_weight(0.5)
        sim.clock.wait(10.0)
        net = 0.2 * GRAVITY * MILLIVOLT_PER_NEWTON + final * math.exp(-7.05)
        assert bench.device("strain_indicator").read().reading_mV == pytest.approx(net, abs=2e-3)


def test_a_reading_above_full_scale_is_an_overload(bench: Bench) -> None:
    bench.device("strain_indicator").configure(8.98, full_scale_mV=50)
    for mass, overload in ((0.4, False), (0.6, True)):
        bench.operator.place_weight(mass)
        bench.clock.wait(2.0)
        shown = bench.device("strain_indicator").read()
        assert (shown.sick, shown.valid) == ("overload" if overload else "", not overload)


@pytest.mark.parametrize("name", ["1", "6"])
def test_the_peak_to_peak_of_a_known_load(name: str, scene: Scene) -> None:
    with SimulatedBench(ideal(scene)) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        bench.operator.mount(SAMPLES[name])
        bench.device("positioner").move(20e-3, speed=5e-3)
        bench.device("shaker_amplifier").configure(gain=2.0, current_limit=5.0, watchdog=2.0)
        bench.device("strain_indicator").peak_to_peak(1.0)
        drive(bench, 1.5)
        bench.clock.wait(0.999)
        assert not bench.device("strain_indicator").read().stable
        bench.clock.wait(0.002)
        shown = bench.device("strain_indicator").read()
        stack = response(scene.design, Load(1.0, SAMPLES[name]), scene.model).stiffness
        rig = scene.rig
    force = 2 * 1.5 * 2.0 / rig.coil_resistance * rig.force_constant * stack / (stack + rig.suspension_stiffness)
    assert shown.stable
    assert shown.reading_mV == pytest.approx(force * MILLIVOLT_PER_NEWTON, rel=1e-4)


def test_peak_to_peak_sees_only_its_window(bench: Bench) -> None:
    bench.device("strain_indicator").peak_to_peak(1.0)
    bench.operator.place_weight(0.5)
    bench.clock.wait(0.5)
    assert bench.device("strain_indicator").read().reading_mV > 40
    bench.clock.wait(0.6)
    assert bench.device("strain_indicator").read().reading_mV < 4


# --- the driver by itself ------------------------------------------------------------------------------


STABLE, OVERLOAD, OPEN = (1 << STRAIN_INDICATOR["status"].bits[bit] for bit in ("stable", "overload", "bridge_open"))


def indicator(**held: Any) -> tuple[StrainIndicator, Any, VirtualClock]:
    link: Any = Registers(STRAIN_INDICATOR, status=STABLE, **held)
    clock = VirtualClock()
    return StrainIndicator.at(DevicePlace(link, 1, None, clock)), link, clock


def shows(link: Any, counts: int, decimals: int = 1) -> None:
    link.put(reading=counts, decimals=decimals, reading_float=counts * 10.0**-decimals)


# --- one reading ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("counts", "decimals", "reading", "step"), [(123, 1, 12.3, 0.1), (-45, 0, -45.0, 1.0)])
def test_the_display_is_read_with_the_place_of_its_point(
    counts: int, decimals: int, reading: float, step: float
) -> None:
    driver, link, _ = indicator()
    assert math.isnan(driver.resolution_mV)
    shows(link, counts, decimals)
    assert driver.read() == IndicatorReading(pytest.approx(reading), step, "", "")  # type: ignore[arg-type]
    assert driver.resolution_mV == step


@pytest.mark.parametrize(
    ("status", "valid", "sick"),
    [
        (STABLE, True, ""),
        (0, False, ""),  # only moving
        (STABLE | OVERLOAD, False, "overload; check the bridge and its wires"),
        (OPEN, False, "bridge open; check the bridge and its wires"),
        (STABLE | OPEN | OVERLOAD, False, "bridge open, overload; check the bridge and its wires"),
    ],
)
def test_a_reading_is_valid_where_it_stands_still_and_the_bridge_is_whole(status: int, valid: bool, sick: str) -> None:
    driver, link, _ = indicator()
    link.put(status=status)
    assert driver.read().valid is valid
    assert driver.sick() == sick


@pytest.mark.parametrize(
    ("counts", "floating", "used"),
    [
        (100, 10.1, True),  # within a step: the display rounds
        (100, 9.9, True),
        (100, 10.11, False),
        (100, 9.89, False),
        (-100, -10.11, False),
        (-100, 10.0, False),
        (100, math.nan, False),
        (2_000_000, 200_000.25, True),  # the float has 24 bits
        (2_000_000, 200_000.5, False),
    ],
)
def test_the_integer_and_the_float_agree_within_a_step_and_the_precision_of_a_float(
    counts: int, floating: float, used: bool
) -> None:
    driver, link, _ = indicator()
    link.put(reading=counts, decimals=1, reading_float=floating)
    if used:
        assert driver.read().reading_mV == pytest.approx(counts / 10)
        return
    with pytest.raises(
        DeviceError, match=rf"reading is {counts / 10:g} mV as an integer and .* as a float, so it is not used"
    ):
        driver.read()


def test_an_open_bridge_reads_nothing_whatever_the_two_readings_say() -> None:
    driver, link, _ = indicator(reading=100, reading_float=math.nan)
    link.put(status=OPEN)
    reading = driver.read()
    assert math.isnan(reading.reading_mV)
    assert (reading.sick, reading.valid) == ("bridge open", False)


# --- displays that are not renewed -----------------------------------------------------------------------


@pytest.mark.parametrize(("seconds", "stale"), [(0.3, False), (0.301, True), (100.0, True)])
def test_a_display_is_stale_when_it_was_not_renewed_though_there_was_time_for_three(
    seconds: float, stale: bool
) -> None:
    driver, link, clock = indicator(updates=7)
    assert not driver.read().sick
    clock.wait(seconds)
    reading = driver.read()
    assert reading.sick == ("display not updated" if stale else "")
    link.put(updates=8)
    assert not driver.read().sick


def test_a_reading_with_the_count_of_the_one_before_is_asked_for_once_more() -> None:
    """It may be the reply of then, which was late; on a serial line the second one has another length."""
    driver, link, _ = indicator(updates=7)
    driver.read()
    assert len(link.asked) == 1
    driver.read()
    assert len(link.asked) == 3
    link.put(updates=8)
    driver.read()
    assert len(link.asked) == 4


@pytest.mark.parametrize(
    ("before", "now", "seconds", "used"),
    [
        (100, 101, 1.0, True),
        (100, 100 + 32768, 1.0, True),  # half the numbers that the counter has
        (100, 100 + 32769, 1.0, False),
        (100, 99, 1.0, False),
        (65535, 0, 1.0, True),  # it starts over
        (0, 65535, 1.0, False),
        (100, 99, 999.9, False),
        (100, 99, 1000.0, True),  # so long that it may have come round
    ],
)
def test_a_display_that_was_renewed_less_often_than_before_is_an_old_reply(
    before: int, now: int, seconds: float, used: bool
) -> None:
    driver, link, clock = indicator(updates=before)
    driver.read()
    clock.wait(seconds)
    link.put(updates=now)
    if used:
        assert not driver.read().sick
        assert link.distrusted == 0
        return
    with pytest.raises(
        DeviceError, match=f"updated {now} times, but {before} times at the reading before; the reply is late"
    ):
        driver.read()
    assert link.distrusted == 1  # the true reply may still come


# --- settings and commands -----------------------------------------------------------------------------


COMMANDS = STRAIN_INDICATOR["command"].choices
RESULTS = STRAIN_INDICATOR["command_result"].choices


def carried_out(link: Any, clock: VirtualClock, after: float, last: str, result: str) -> None:
    """The command is done `after` s."""
    begun = clock.now_ns()

    def look(reply: Any) -> Any:
        if getattr(reply, "registers", None) and 1e-9 * (clock.now_ns() - begun) >= after:
            link.put(command="idle", last_command=COMMANDS[last], command_result=RESULTS[result])
        return reply

    link.replied = look


@pytest.mark.parametrize(
    ("last", "result", "ended"), [("zero", "refused_unstable", "refused_unstable"), ("tare", "done", "done")]
)
def test_a_command_that_was_refused_or_was_another_one_is_told(last: str, result: str, ended: str) -> None:
    driver, link, clock = indicator()
    carried_out(link, clock, 0.0, last, result)
    with pytest.raises(DeviceError, match=f"^strain indicator at .*: zero ended in {ended}; wait for a stable reading"):
        driver.command("zero")


def test_a_command_is_not_waited_for_longer_than_a_second() -> None:
    driver, _, clock = indicator()
    begun = clock.now_ns()
    with pytest.raises(DeviceError, match=r"tare was not carried out within 1 s; repeat it, or restart the indicator$"):
        driver.command("tare")
    assert clock.now_ns() - begun == pytest.approx(1e9)
