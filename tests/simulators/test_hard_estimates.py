"""Hard cases of what is made of samples, each with the naive method beside it, shown failing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.instrument.contracts.own import SENSOR_NODE
from palpate.instrument.errors import EstimateError
from palpate.instrument.findings.object_modulus import modulus_of_ratio
from palpate.instrument.models.curve import ratio_curve
from palpate.instrument.models.parameters import PHYSICAL
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.signals.estimate import fit_sine
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.linear.periodic import HERTZ, SECOND, Periodic
from palpate.simulators.randomness import Stream
from palpate.simulators.rig import Rig
from tests.simulators.rigs import MS, scene


def test_a_record_below_a_quarter_cycle_gives_any_amplitude_where_the_fit_refuses() -> None:
    """The record holds a fifth of a cycle with 3 % noise, and its offset is unknown."""
    t = np.arange(20) * 1e-3
    columns = np.stack([np.cos(20 * np.pi * t), np.sin(20 * np.pi * t), np.ones_like(t), t / t[-1]], axis=1)
    clean = np.sin(20 * np.pi * t + 0.3) + 0.5
    noisy = [clean + 0.03 * Stream(seed, "short").normal(0, len(t)) for seed in range(300)]
    found = [float(np.hypot(*np.linalg.lstsq(columns, y, rcond=None)[0][:2])) for y in noisy]
    assert np.std(found) > 0.5  # of an amplitude of 1
    for y in noisy[:3]:
        with pytest.raises(EstimateError, match=r"record of 0\.2 cycles of 10 Hz"):
            fit_sine(t, y[np.newaxis], 10.0)


def test_moduli_near_saturation_have_no_mean_where_a_lower_bound_holds() -> None:
    """R = 0.999 known to 0.001: the column's E has a pole at R = 1."""
    single, share = get_design("single"), 1.4**2 / (1.4**2 + 5**2 - 1.5**2)
    true = 24e3 * 3 / 3.88 * (0.999 - share) / (share * (1 - 0.999))
    noise = 1e-3 * Stream(1, "saturated").normal(0, 20_000)
    ratios = 0.999 + noise
    naive = 24e3 * 3 / 3.88 * (ratios - share) / (share * (1 - ratios))
    means = naive.reshape(20, 1000).mean(axis=1)
    assert np.ptp(means) > 5 * true  # more of them do not help
    assert (naive < 0).mean() > 0.1
    found = modulus_of_ratio(ratio_curve(single, PHYSICAL.load(1e5), "column"), ratios[ratios < 1][:200], u=1e-3)
    assert set(found.kind) == {"at least"}
    assert (found.low < true).mean() > 0.95
    assert np.isnan(found.modulus).all()


def test_a_time_in_single_precision_is_off_by_seconds_where_number_and_period_give_the_nanosecond() -> None:
    """After a year a register in seconds is compared with the node's counter times its period."""
    number, period_ns = 31_557_601, SECOND + 1  # samples a second apart, and a nanosecond
    time_ns = number * period_ns
    assert abs(float(np.float32(time_ns / SECOND)) - time_ns / SECOND) > 0.5
    contract = SENSOR_NODE
    counted = contract.decode("sample_counter", contract.encode("sample_counter", number))
    assert int(counted) * period_ns == time_ns
    drive = Periodic(0.0, 10 * HERTZ, 0, 0, np.array([1]), np.array([-1j]))
    assert drive.at(np.array([time_ns]))[0] == pytest.approx(math.sin(2 * math.pi * 0.315_576_01), abs=1e-9)


@pytest.mark.parametrize(
    ("volts", "cast", "counts"),
    [(0.0, 0, 0), (1e-300, 0, 0), (-5.0, -32_768, -32_768), (5.0, -32_768, 32_767), (6.0, -26_214, 32_767)],
)
def test_nothing_and_full_scale_are_converted_where_a_cast_turns_round(volts: float, cast: int, counts: int) -> None:
    assert np.array(round(volts / 5.0 * 2**15)).astype(np.int16) == cast
    node = SimulatedSensorNode(VirtualClock(), 1, 1, Rig(scene(), VirtualClock()))
    samples = node.sample(np.arange(1, 4) * MS, np.full((4, 3), volts), MS)
    assert (samples.counts == counts).all()
    assert (samples.saturation == (0b1111 if volts >= 5.0 else 0)).all()
