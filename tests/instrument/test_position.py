"""Shares under a point load and the place that they tell; and shear, which some films take for another place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.errors import RangeError
from palpate.instrument.findings.position import locate
from palpate.instrument.models.influence import ERROR, shares_along, tooth_shares
from palpate.instrument.models.parameters import solid_parameters
from palpate.instrument.models.shear import DRAGGED, FilmShear, shear, shear_pattern
from palpate.instrument.models.solid.model import point_loads
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import Load, get_sample

DESIGN = get_design("common_base")
HARD = get_sample("1")
MIDDLE = 6e-3


def test_the_table_is_what_the_solid_model_says() -> None:
    place = (12e-3, MIDDLE)  # in the middle, where a quarter of the sensor is solved for
    (shares,) = point_loads(solid_parameters(DESIGN, Load(1.0, HARD)), [place], 0)
    assert tooth_shares(DESIGN, HARD, place) == pytest.approx(tuple(shares), abs=1e-4)


def test_what_a_bench_tells_of_films_and_cables_moves_no_load() -> None:
    """A stated noise or pick-up, and a calibration of the films, belong to the same sensor."""
    known = replace(DESIGN, film_covariance=((1e-4,) * 4,) * 4, film_freedom=5.0).with_pickup(0.01).with_noise(2e-6)
    place = (6e-3, MIDDLE)
    assert tooth_shares(known, HARD, place) == tooth_shares(DESIGN, HARD, place)


@pytest.mark.parametrize("name", list("123456"))
def test_shares_are_mirrored_peak_above_the_teeth_and_never_pull(name: str) -> None:
    x = np.linspace(0, 24e-3, 97)
    left, right = shares_along(DESIGN, get_sample(name), x)
    assert left[::-1] == pytest.approx(right)
    assert x[left.argmax()] == pytest.approx(6e-3)
    assert (left >= 0).all()
    assert (left + right <= 1).all()


def test_a_harder_object_hands_less_to_the_tooth_below_it_where_it_spreads_the_load() -> None:
    at = (10e-3, MIDDLE)
    assert tooth_shares(DESIGN, HARD, at)[0] > tooth_shares(DESIGN, get_sample("2"), at)[0]


@pytest.mark.parametrize("place", [0.0, 3e-3, 9e-3, 12e-3, 17e-3, 22.5e-3])
def test_exact_shares_give_their_place(place: float) -> None:
    found = locate(DESIGN, HARD, tooth_shares(DESIGN, HARD, (place, MIDDLE)), (1e-4, 1e-4), np.diag([1e-6, 1e-6]))
    assert found.position == pytest.approx(place, abs=1e-4)
    assert found.low <= place <= found.high


def test_the_interval_holds_the_place_as_often_as_it_says() -> None:
    random = np.random.default_rng(5)
    scatter, inside = np.array([[36e-4, -9e-4], [-9e-4, 9e-4]]), 0
    triangle = np.linalg.cholesky(scatter)
    for place in np.linspace(0.2e-3, 23.8e-3, 200):
        true = np.array(tooth_shares(DESIGN, HARD, (float(place), MIDDLE)))
        model = ERROR / np.sqrt(3) * random.standard_normal(2)
        seen = true * (1 + triangle @ random.standard_normal(2)) + model
        found = locate(DESIGN, HARD, tuple(seen), (0.0, 0.0), scatter)
        inside += found.low <= place <= found.high
    assert 0.91 <= inside / 200 <= 0.99


def test_where_two_places_give_the_same_the_uncertainty_says_so() -> None:
    beside, between = (
        locate(DESIGN, HARD, tooth_shares(DESIGN, HARD, (x, MIDDLE)), (1e-3, 1e-3), np.diag([36e-4, 9e-4]))
        for x in (4e-3, 12e-3)
    )
    assert beside.u > 5 * between.u


@pytest.mark.parametrize(
    ("design", "sample", "place", "message"),
    [
        ("single", "1", (5e-3, 5e-3), "point loads are known for design 'common_base'"),
        ("common_base", "1", (25e-3, 6e-3), "position 25 mm is off the sensor, which reaches from 0 to 24 mm"),
        ("common_base", "1", (6e-3, 5e-3), "y = 5 mm is off the centre line"),
    ],
)
def test_what_the_table_does_not_hold_is_refused(
    design: str, sample: str, place: tuple[float, float], message: str
) -> None:
    with pytest.raises(RangeError, match=message):
        tooth_shares(get_design(design), get_sample(sample), place)


# --- Shear on a sensor: what films feel of it, and which load off centre does as much ------------------

SAMPLE = get_sample("1")
STIFF = replace(SAMPLE, modulus=1e12)


def film(leaning: float, dragged: float) -> FilmShear:
    return FilmShear(0.2, leaning, dict.fromkeys(DRAGGED, dragged), 24e-3)


def test_films_tell_shear_from_a_load_off_centre_where_they_name_different_places() -> None:
    still = film(1e-11, 1e-12)
    assert still.off_centre("object") is None
    assert still.cleaned("object") == 0
    assert shear_pattern({"a": still}) == "not"
    pair = {"a": film(-20.0, -0.02), "b": film(20.0, 0.02), "all": still}
    assert pair["a"].off_centre("object") == pytest.approx(1e-3)
    assert shear_pattern(pair) == "off centre"
    assert shear_pattern({**pair, "c": film(60.0, 0.12)}) == "apart"
    assert film(20.0, 0.02).change(film(20.0, 0.018)) == pytest.approx(2e-3)


@pytest.mark.slow
def test_no_film_below_one_tooth_feels_shear() -> None:
    for felt in shear(get_design("single"), SAMPLE).values():
        assert felt.pressed > 0.1
        assert felt.off_centre("object") is None
        assert max(map(abs, felt.dragged.values())) < 1e-9


@pytest.mark.slow
def test_two_teeth_on_one_base_take_shear_for_a_load_off_centre_and_on_two_bases_not() -> None:
    common = shear(get_design("common_base"), SAMPLE)
    assert shear_pattern(common) == "off centre"
    assert common["rigid_1"].dragged["object"] == pytest.approx(-common["rigid_2"].dragged["object"])
    assert common["rigid_2"].dragged["object"] > 1e-3
    assert abs(common["total"].dragged["object"]) < 1e-9
    assert abs(common["rigid_1"].dragged["tooth"]) < 1e-3
    assert shear_pattern(shear(get_design("different_base"), SAMPLE)) == "apart"


@pytest.mark.slow
def test_on_a_stiff_object_shear_is_a_force_on_the_face_and_a_moment_of_its_height() -> None:
    low, high = (
        shear(get_design("common_base"), replace(STIFF, thickness=thickness))["rigid_2"] for thickness in (2e-3, 4e-3)
    )
    assert low.leaning == pytest.approx(high.leaning, rel=1e-3)
    assert high.dragged["object"] - low.dragged["object"] == pytest.approx(2e-3 * low.leaning, rel=5e-3)
