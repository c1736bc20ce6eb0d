"""The force that acts: by the stack, from contact to loss of contact, and what a peak detector makes of it."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.load_indicator import SimulatedStrainIndicator
from palpate.simulators.rig import Rig
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


def test_force_begins_where_the_probe_meets_the_sample_and_grows_with_the_advance() -> None:
    rig = Rig(scene(), VirtualClock())
    rig.mount(SAMPLES["2"])
    now = np.array([0])
    for position, expected in ((0.0, 0.0), (BALANCE - 1e-6, 0.0), (BALANCE + 1e-3, 1.0), (BALANCE + 4e-3, 4.0)):
        rig.set_position(position)
        assert rig.cell_force(now)[0] == pytest.approx(expected * share(rig.scene, "2"), abs=1e-12)


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
