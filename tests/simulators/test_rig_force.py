"""The force that acts: by the stack, from contact to loss of contact, and what a peak detector makes of it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.load_indicator import SimulatedStrainIndicator
from palpate.simulators.linear.lti import Floats
from palpate.simulators.rig.rig import IDEAL_SENSITIVITY, Rig
from tests.simulators.rigs import BALANCE, MS, pressed, scene, share, waveform


def force_over_a_cycle(sample: str, position: float, amplitude: float, kind: str = "sine") -> tuple[Floats, Floats]:
    """The rig's force, and what it would be without loss of contact."""
    chosen = scene()
    rig = Rig(chosen, VirtualClock())
    pressed(rig, sample, position, amplitude, kind)
    times = np.arange(0, 100 * MS, 50_021)
    drive = waveform(kind, amplitude).at(times) * chosen.rig.force_constant / chosen.rig.coil_resistance
    preload = chosen.rig.suspension_stiffness * (position - BALANCE)
    return rig.cell_force(times), share(chosen, sample) * (drive + preload)


def test_a_softer_sample_takes_less_force_for_the_same_drive() -> None:
    by_modulus = sorted(SAMPLES.values(), key=lambda sample: sample.modulus)
    swings = [np.ptp(force_over_a_cycle(sample.name, BALANCE + 9e-3, 3.0)[0]) for sample in by_modulus]
    assert all(softer < harder for softer, harder in itertools.pairwise(swings))
    assert swings[-1] < 2 * 3.0 * 4.0 / 3.5  # never more than the coil's own force
    chosen = scene()
    for sample, swing in zip(by_modulus, swings, strict=True):
        assert swing == pytest.approx(2 * 3.0 * 4.0 / 3.5 * share(chosen, sample.name), rel=1e-6)


def test_a_stiffer_suspension_leaves_less_force() -> None:
    swings = []
    for stiffness in ("500 N/m", "1000 N/m", "3000 N/m"):
        rig = Rig(scene(suspension_stiffness=stiffness), VirtualClock())
        pressed(rig, "2", BALANCE + 9e-3, 2.0)
        swings.append(np.ptp(rig.cell_force(np.arange(0, 100 * MS, MS))))
    assert swings[0] > swings[1] > swings[2] > 0


def test_force_begins_where_the_probe_meets_the_sample_and_grows_with_the_advance() -> None:
    rig = Rig(scene(), VirtualClock())
    rig.mount(SAMPLES["2"])
    now = np.array([0])
    for position, expected in ((0.0, 0.0), (BALANCE - 1e-6, 0.0), (BALANCE + 1e-3, 1.0), (BALANCE + 4e-3, 4.0)):
        rig.set_position(position)
        assert rig.cell_force(now)[0] == pytest.approx(expected * share(rig.scene, "2"), abs=1e-12)


def test_without_a_sample_nothing_presses_but_the_weights() -> None:
    rig = Rig(scene(), VirtualClock())
    rig.set_position(20e-3)
    rig.set_voltage(waveform("sine", 3.0))
    rig.place_weight(0.14)
    times = np.arange(0, 200 * MS, MS)
    assert (rig.cell_force(times) == 0.14 * 9.80665).all()
    assert (rig.film_voltages(times) == 0).all()


@pytest.mark.parametrize(("kind", "sample"), [("sine", "1"), ("triangle", "2"), ("square", "1")])
def test_where_contact_is_lost_the_force_is_clipped_at_zero(kind: str, sample: str) -> None:
    lost = 0
    for position in np.linspace(BALANCE - 6e-3, BALANCE + 7e-3, 14):
        force, linear = force_over_a_cycle(sample, float(position), 5.0, kind)
        assert np.abs(force - np.maximum(linear, 0)).max() < 1e-12 * np.ptp(linear)
        lost += bool((linear < 0).any() and (linear > 0).any())
    assert lost > 8


@pytest.mark.parametrize("kind", ["sine", "square"])
def test_out_of_reach_the_force_is_exactly_zero_and_in_full_contact_exactly_linear(kind: str) -> None:
    force, _ = force_over_a_cycle("2", BALANCE - 20e-3 if kind == "sine" else 0.0, 2.0, kind)
    assert (force == 0).all()
    force, linear = force_over_a_cycle("2", BALANCE + 9e-3, 2.0, kind)
    assert np.allclose(force, linear, rtol=0, atol=1e-12)


# --- the peak-to-peak detector -------------------------------------------------------------------------


def indicator(rig: Rig, clock: VirtualClock, window: float) -> SimulatedStrainIndicator:
    device = SimulatedStrainIndicator(clock, "SIM-SI-0001", rig)
    device.write({"mode": 1.0, "filter": window})
    return device


def test_the_peak_detector_reads_the_swing_of_the_load_whatever_its_mean() -> None:
    for advance, weight in ((6e-3, 0.0), (9e-3, 0.0), (6e-3, 0.74)):
        clock = VirtualClock()
        rig = Rig(scene(), clock)
        pressed(rig, "2", BALANCE + advance, 2.0)
        rig.place_weight(weight)
        device = indicator(rig, clock, 0.5)
        clock.wait(1.0)
        swing = 2 * 2.0 * 4.0 / 3.5 * share(rig.scene, "2")
        assert device.read("reading_float") == pytest.approx(1e3 * IDEAL_SENSITIVITY * swing, rel=1e-4)


def test_the_peak_detector_forgets_a_larger_swing_after_its_window_and_not_before() -> None:
    clock = VirtualClock()
    rig = Rig(scene(), clock)
    pressed(rig, "2", BALANCE + 9e-3, 3.0)
    device = indicator(rig, clock, 0.5)
    clock.wait(2.0)
    large = device.read("reading_float")
    rig.set_voltage(waveform("sine", 1.0))
    clock.wait(0.35)
    assert device.read("reading_float") == pytest.approx(large, rel=1e-4)
    clock.wait(0.25)
    assert device.read("reading_float") == pytest.approx(large / 3, rel=1e-4)
