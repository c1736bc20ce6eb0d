from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.errors import RangeError
from palpate.instrument.models import springs
from palpate.instrument.models.response import response
from palpate.instrument.models.table import MODELS
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES, Load, Sample, get_sample

SINGLE = get_design("single")
AREA_SHARE = 1.4**2 / (1.4**2 + 5.0**2 - 1.5**2)


def rubber(modulus: float, thickness: float = 3e-3) -> Sample:
    return replace(get_sample("2"), name="trial", modulus=modulus, thickness=thickness)


def ratio(sensed: Sample, model: str) -> float:
    return response(SINGLE, Load(force=3.0, sensed=sensed), model).force_ratio


@pytest.mark.parametrize(("modulus", "thickness"), [(24131.65, 3e-3), (112609.9, 3e-3), (7.5e6, 0.55e-3)])
def test_the_column_ratio_is_the_closed_form(modulus: float, thickness: float) -> None:
    hardness = modulus * 3.88e-3 / (24e3 * thickness)
    expected = AREA_SHARE * (1 + hardness) / (1 + AREA_SHARE * hardness)
    assert ratio(rubber(modulus, thickness), "column") == pytest.approx(expected, rel=1e-14)


def test_the_column_takes_an_array_of_moduli() -> None:
    moduli = np.array([[1.49e4, 3e4, 1e6], [1e7, 140e6, 140e9]])
    expected = [[springs.ratio_of_modulus(SINGLE, float(m), 3e-3) for m in row] for row in moduli]
    np.testing.assert_array_equal(springs.ratio_of_modulus(SINGLE, moduli, 3e-3), expected)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_the_column_refuses_an_array_with_one_bad_modulus(bad: float) -> None:
    with pytest.raises(RangeError, match="modulus"):
        springs.ratio_of_modulus(SINGLE, np.array([1e4, bad]), 3e-3)
    with pytest.raises(RangeError, match="thickness"):
        springs.ratio_of_modulus(SINGLE, 1e4, bad)


def test_the_stack_is_the_tooth_column_beside_the_ring_column() -> None:
    object_per_area, ring_per_area = 24131.65 / 3e-3, 24e3 / 3.88e-3
    tooth = 1.4e-3**2 * math.pi * object_per_area
    ring = (5e-3**2 - 1.5e-3**2) * math.pi / (1 / object_per_area + 1 / ring_per_area)
    answer = response(SINGLE, Load(force=3.0, sensed=get_sample("2")), "column")
    assert answer.stiffness == pytest.approx(tooth + ring, rel=1e-12)
    assert answer.force_ratio == pytest.approx(tooth / (tooth + ring), rel=1e-12)


def test_the_experiment_has_no_step_at_a_sample() -> None:
    for name, measured in SINGLE.thesis_force_ratio.items():
        towards_the_others = 1e-9 if name != "1" else -1e-9  # the hardest
        beside = rubber(get_sample(name).modulus * (1 + towards_the_others))
        assert ratio(beside, "experiment") == pytest.approx(measured, rel=1e-7)


def test_the_experiment_rises_with_the_modulus_between_the_samples() -> None:
    moduli = np.geomspace(24131.65, 112609.9, 500)[1:-1]
    assert np.all(np.diff([ratio(rubber(m), "experiment") for m in moduli]) > 0)


@pytest.mark.parametrize("modulus", [24131.0, 112610.0])
def test_the_experiment_does_not_extrapolate(modulus: float) -> None:
    with pytest.raises(RangeError, match=r"outside the measured 24.13165 kPa to 112.6099 kPa"):
        ratio(rubber(modulus), "experiment")


def test_the_experiment_answers_for_the_measured_thickness_only() -> None:
    with pytest.raises(RangeError, match=r"thickness 4.7 mm .* measured 3 mm"):
        ratio(rubber(30e3, thickness=4.7e-3), "experiment")


@pytest.mark.parametrize("model", sorted(MODELS.keys() - {"axisymmetric", "solid"}))
def test_every_model_puts_the_samples_in_the_order_of_the_thesis(model: str) -> None:
    order = sorted(SAMPLES, key=lambda name: -ratio(get_sample(name), model))
    assert tuple(order) == SINGLE.thesis_softness_order


@pytest.mark.parametrize("model", sorted(MODELS.keys() - {"axisymmetric", "solid"}))
def test_forces_are_proportional_to_the_load_and_in_their_ratio(model: str) -> None:
    one, four = (response(SINGLE, Load(force=force, sensed=get_sample("3")), model) for force in (1.0, 4.0))
    assert four.force_total == pytest.approx(4.0, rel=1e-11)  # a sum of poles rounds
    assert four.force_rigid == pytest.approx(4 * one.force_rigid, rel=1e-14)
    assert four.force_rigid / four.force_total == pytest.approx(four.force_ratio, rel=1e-14)
    assert four.stiffness == one.stiffness > 0


@pytest.mark.parametrize("force", [0.0, -1.0, math.nan, math.inf])
def test_a_load_is_positive_and_finite(force: float) -> None:
    with pytest.raises(RangeError, match=r"load .* N is not above 0"):
        Load(force=force, sensed=get_sample("1"))
