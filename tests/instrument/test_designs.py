"""The designs: what their numbers must satisfy, whatever they are."""

from __future__ import annotations

import pytest

from palpate.instrument.errors import RangeError
from palpate.instrument.models.parameter_sets import PHYSICAL
from palpate.instrument.models.parameters import solid_parameters
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.sensor.designs import DESIGNS, get_design
from palpate.instrument.sensor.designs.array import array_of
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.thesis import read_table


@pytest.mark.parametrize("design", DESIGNS.values(), ids=lambda design: design.name)
def test_parts_of_a_design_do_not_overlap(design: Design) -> None:
    parameters = solid_parameters(design, PHYSICAL.load(1e5))
    assert parameters.columns * parameters.rows == len(design.teeth)
    bases = len(design.teeth) if design.separate_bases else 1
    area = bases * design.plate.length * design.plate.width
    assert parameters.length * parameters.width == pytest.approx(area, rel=1e-12)


@pytest.mark.parametrize("design", DESIGNS.values(), ids=lambda design: design.name)
def test_every_tooth_has_its_film_and_every_film_its_channel(design: Design) -> None:
    assert [film.channel for film in design.films] == list(range(1, len(design.films) + 1))
    rigid = [film.teeth for film in design.films if film.name.startswith("rigid")]
    assert rigid == [(k,) for k in range(len(design.teeth))]
    total = [tooth for film in design.films if film.name.startswith("total") for tooth in film.teeth]
    assert sorted(total) == list(range(len(design.teeth)))


@pytest.mark.parametrize("name", ["single", "common_base", "different_base"])
def test_measured_designs_order_the_samples_by_hardness(name: str) -> None:
    design = get_design(name)
    assert set(design.thesis_force_ratio) == set(design.thesis_softness_order) == set(SAMPLES)
    assert design.thesis_force_ratio["1"] == max(design.thesis_force_ratio.values())
    assert design.thesis_force_ratio["2"] == min(design.thesis_force_ratio.values())


@pytest.mark.parametrize("count", [8, 11, 22])
def test_an_array_of_another_size_is_refused(count: int) -> None:
    with pytest.raises(RangeError, match=f"array of {count} teeth"):
        array_of(count)


@pytest.mark.parametrize("film", get_design("different_base").films, ids=lambda film: film.name)
def test_films_of_the_different_bases_are_those_of_table_5_7(film: Film) -> None:
    """Mean and standard deviation of voltage over force, over the six samples."""
    table, kind = (
        read_table("5.7"),
        "" if film.name.startswith("rigid") else ("_total_left", "_total_right")[film.teeth[0]],
    )
    sensitivity = table.values(f"pvdf{film.channel}{kind}_mV") / table.values(f"force{film.channel}{kind}_N")
    assert 1e3 * film.sensitivity == pytest.approx(sensitivity.mean(), rel=1e-4)
    assert film.scatter == pytest.approx(sensitivity.std(ddof=1) / sensitivity.mean(), abs=5e-4)


def test_the_ratios_of_the_different_bases_are_those_of_table_5_7() -> None:
    table = read_table("5.7")
    assert get_design("different_base").thesis_force_ratio == dict(
        zip(table.rows, table.values("force_ratio").tolist(), strict=True)
    )
