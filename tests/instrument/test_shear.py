"""Shear on a sensor: what films feel of it, and which load off centre does as much."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.instrument.models.shear import DRAGGED, FilmShear, shear, shear_pattern
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample

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
