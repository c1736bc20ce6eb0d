"""Glue, neighbours, angle, warmth and cables: what the films make of the force, by formulas of their own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import MOST, array_of, get_design
from palpate.instrument.signals.estimate import fit_sine
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects.charge_amplifier import ChargeAmplifier
from palpate.simulators.effects.crosstalk import Crosstalk
from palpate.simulators.effects.glue_clamping import GlueClamping
from palpate.simulators.effects.off_axis import OffAxis
from palpate.simulators.effects.pyroelectric import Pyroelectric
from palpate.simulators.effects.triboelectric import Triboelectric
from palpate.simulators.physics.effect import Effect
from palpate.simulators.randomness import Stream
from palpate.simulators.rig import Rig
from tests.simulators.rigs import BALANCE, MS, SECOND, pressed, scene

ANY = Stream(1, "any")


def driven(effects: Mapping[str, Effect], design: str = "single", amplitude: float = 2.0) -> Rig:
    rig = Rig(replace(scene(), effects=effects, design=get_design(design)), VirtualClock())
    pressed(rig, "2", BALANCE + 7e-3, amplitude)
    return rig


def amplitudes(rig: Rig, first_ns: int = SECOND) -> Floats:
    times = first_ns + np.arange(0, SECOND, MS)
    return fit_sine(1e-9 * times, rig.film_voltages(times), 10.0).amplitude


def change(effects: Mapping[str, Effect], design: str = "single") -> Floats:
    """Relative changes of the films' amplitudes."""
    return amplitudes(driven(effects, design)) / amplitudes(driven({}, design)) - 1


# --- gains ---------------------------------------------------------------------------------------------


def test_glue_on_one_film_takes_57_percent_of_the_ratio_and_on_both_none() -> None:
    rigid, total = change({"glue_clamping": GlueClamping()})
    assert (1 + rigid) / (1 + total) - 1 == pytest.approx(-0.57, abs=1e-12)
    rigid, total = change({"glue_clamping": GlueClamping(films=("rigid", "total"), factor=0.59)})
    assert (rigid, total) == pytest.approx((-0.41, -0.41), abs=1e-12)
    assert rigid == pytest.approx(total, abs=1e-12)


def test_ten_degrees_take_1_5_percent_of_the_force_and_none_of_the_ratio() -> None:
    rigid, total = change({"off_axis": OffAxis()})
    assert total == pytest.approx(math.cos(math.radians(10)) - 1, abs=1e-12)
    assert total == pytest.approx(-0.015, abs=5e-4)
    assert rigid == pytest.approx(total, abs=1e-12)


def test_the_lateral_part_adds_by_the_sine_of_the_angle() -> None:
    _, total = change({"off_axis": OffAxis(angle="30 deg", lateral=0.4)})
    assert total == pytest.approx(math.cos(math.pi / 6) + 0.4 * 0.5 - 1, abs=1e-12)


# --- neighbours ----------------------------------------------------------------------------------------


def test_neighbours_on_a_common_base_add_5_2_percent_under_equal_loads() -> None:
    changed = change({"crosstalk": Crosstalk()}, "common_base")
    assert changed == pytest.approx([0.052, 0.052, 0.0], abs=1e-12)


def test_the_parts_of_a_neighbour_are_those_of_table_a2_7() -> None:
    """Rows 3 and 7: the load in the middle of the compliant part, and over the tooth itself."""
    assert Crosstalk().compliant == pytest.approx(0.02416 / 0.46355, rel=0.005)
    assert Crosstalk().rigid == pytest.approx(9.41e-5 / 0.99788, rel=0.05)
    changed = change({"crosstalk": Crosstalk(over_teeth=1.0)}, "common_base")
    assert changed == pytest.approx([9e-5, 9e-5, 0.0], abs=1e-12)


@pytest.mark.parametrize("design", ["single", "different_base"])
def test_teeth_without_a_neighbour_on_their_base_feel_nothing_of_one(design: str) -> None:
    assert (change({"crosstalk": Crosstalk(compliant=0.24)}, design) == 0).all()


def neighbours(design: Design) -> Floats:
    """Which teeth are neighbours, by their numbers: two rows, each from left to right."""
    columns = design.columns
    count = len(design.teeth)
    beside = np.zeros((count, count))
    for k in range(count):
        for other in (
            k - columns,
            k + columns,
            *([k - 1] if k % columns else []),
            *([k + 1] if (k + 1) % columns else []),
        ):
            if 0 <= other < count:
                beside[k, other] = 1.0
    return beside


def test_twenty_teeth_with_the_strongest_crosstalk_still_tell_their_forces_apart() -> None:
    design = array_of(MOST)
    matrix = Crosstalk(compliant=0.24).matrix(design, ANY, 0)
    assert matrix[:MOST, :MOST] == pytest.approx(np.eye(MOST) + 0.24 * neighbours(design), abs=1e-12)
    assert np.linalg.cond(matrix) < 12
    # A larger part would leave nothing of a pattern of pushed and pulled teeth.
    singular = 1 / (1 + 2 * math.cos(math.pi / (design.columns + 1)))
    assert np.linalg.cond(np.eye(MOST) + singular * neighbours(design)) > 1e12
    with pytest.raises(ValueError, match=r"compliant\n.*less than or equal to 0\.24"):
        Crosstalk(compliant=singular)


# --- warmth --------------------------------------------------------------------------------------------


def test_films_that_warm_up_give_the_charge_of_their_temperature() -> None:
    warm = {"pyroelectric": Pyroelectric(drift="20 mK/s", settling="5 s")}
    times = np.arange(0, 20 * SECOND, 77 * MS)
    added = driven(warm).film_voltages(times) - driven({}).film_voltages(times)
    kelvin = 20e-3 * 5 * -np.expm1(-1e-9 * times / 5)
    assert added == pytest.approx(np.outer([5.995e-3 * 9.2, 68.60e-3 * 150.0], kelvin), rel=1e-9, abs=1e-13)


def test_warming_passes_the_charge_amplifier_as_two_exponentials() -> None:
    amplifier: dict[str, Effect] = {"charge_amplifier": ChargeAmplifier(time_constant="1 s")}
    warm = {**amplifier, "pyroelectric": Pyroelectric(drift="20 mK/s", settling="5 s")}
    times = np.arange(0, 20 * SECOND, 77 * MS)
    added = driven(warm).film_voltages(times) - driven(amplifier).film_voltages(times)
    t = 1e-9 * times
    kelvin = 20e-3 * (np.exp(-t / 5) - np.exp(-t)) / (1 / 1 - 1 / 5)
    assert added[1] == pytest.approx(68.60e-3 * 150.0 * kelvin, rel=1e-9, abs=1e-12)


def test_a_fit_with_a_trend_is_spared_the_drift_that_a_plain_rms_takes_for_force() -> None:
    """The drift of 20 mK/s just after the bench is opened; the total film feels 3 N/s."""
    amplifier: dict[str, Effect] = {"charge_amplifier": ChargeAmplifier()}
    cold, warm = (driven({**amplifier, **more}) for more in ({}, {"pyroelectric": Pyroelectric()}))
    times = np.arange(0, SECOND, MS)
    signals = [rig.film_voltages(times)[1] for rig in (cold, warm)]
    fits = [fit_sine(1e-9 * times, [signal], 10.0).amplitude[0] for signal in signals]
    powers = [np.std(signal) for signal in signals]
    assert abs(fits[1] / fits[0] - 1) < 0.0024
    assert abs(powers[1] / powers[0] - 1) > 0.05


# --- cables --------------------------------------------------------------------------------------------


def test_a_cable_of_a_tenth_of_a_picocoulomb_adds_two_percent_to_the_tooth() -> None:
    """0.1 pC beside the 20 pC/N of the film, at 3 N peak to peak; the tooth takes 0.14 to 0.31 of the force."""
    changed = change({"triboelectric": Triboelectric()})
    rig = driven({})
    ratio = float(amplitudes(rig) @ [68.60e-3 / 5.995e-3, 0]) / float(amplitudes(rig)[1])
    per_newton = 0.1 / 20 / 1.5
    assert changed == pytest.approx([per_newton / ratio, per_newton], rel=1e-9)
    assert 0.01 < (1 + changed[0]) / (1 + changed[1]) - 1 < 0.025


def test_what_a_cable_adds_does_not_depend_on_the_dwell() -> None:
    noisy, quiet = driven({"triboelectric": Triboelectric()}), driven({})
    times = SECOND + np.arange(0, 10 * SECOND, MS)
    one, ten = (
        np.divide(*(fit_sine(1e-9 * t, rig.film_voltages(t), 10.0).amplitude for rig in (noisy, quiet)))
        for t in (times[:1000], times)
    )
    assert ten == pytest.approx(one, rel=1e-9)
    assert one[0] > 1.01
