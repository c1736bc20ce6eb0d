"""The strain indicator reads the load cell, and takes zero and tare by command and acknowledge."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.errors import DeviceError
from palpate.instrument.models.response import response
from palpate.instrument.sensor.sample import SAMPLES, Load
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.device import SimulatedDevice
from palpate.testing import RtuConformance

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


def test_the_filter_follows_with_its_time_constant(scene: Scene) -> None:
    with SimulatedBench(ideal(scene)) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        bench.device("strain_indicator").track(2.0)
        bench.clock.wait(20.0)
        bench.operator.place_weight(0.5)
        sim.clock.wait(2.0)
        final = 0.5 * GRAVITY * MILLIVOLT_PER_NEWTON
        assert bench.device("strain_indicator").read().reading_mV == pytest.approx(final * (1 - math.exp(-1)), abs=1e-3)


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
