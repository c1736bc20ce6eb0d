"""The designs: what their numbers must satisfy, whatever they are."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.errors import RangeError
from palpate.instrument.models.parameters import PHYSICAL, solid_parameters
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.sensor.designs import DESIGNS, array_of, get_design
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


def test_films_of_the_common_base_scatter_together_as_in_its_rows_and_the_ratio_repeats_as_the_tables_own() -> None:
    """Tables A2.15 to A2.20: the correlations of the rows are known to 0.15 where none is."""
    design, names = get_design("common_base"), ("rigid_1", "rigid_2", "total")
    tables = [read_table(f"A2.{number}") for number in range(15, 21)]
    columns = (("pvdf1_mV", "force1_N"), ("pvdf2_mV", "force2_N"), ("pvdf3_total_mV", "force_total_N"))
    gains = [np.concatenate([each.values(volts) / each.values(force) for each in tables]) for volts, force in columns]
    found = np.corrcoef(gains)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert design.scatter_correlation[names[i], names[j]] == pytest.approx(found[i, j], abs=0.04)
    ratios = [(each.values("force1_N") + each.values("force2_N")) / each.values("force_total_N") for each in tables]
    repeated = math.sqrt(np.mean([(each.std(ddof=1) / each.mean()) ** 2 for each in ratios]))
    assert design.ratio_scatter == pytest.approx(repeated, abs=5e-4)


@pytest.mark.parametrize(
    ("correlation", "message"),
    [
        ({("rigid_1", "tota"): 0.5}, r"\('rigid_1', 'tota'\): give the names of two of its films: rigid_1, rigid_2, t"),
        ({("total", "total"): 0.5}, r"\('total', 'total'\): give the names of two of its films"),
        ({("rigid_1", "total"): 1.5}, r"\('rigid_1', 'total'\): 1.5 is not from -1 to 1"),
        ({("rigid_1", "total"): math.nan}, r"\('rigid_1', 'total'\): nan is not from -1 to 1"),
        ({("rigid_1", "total"): 0.5, ("total", "rigid_1"): 0.5}, r"\('total', 'rigid_1'\): the pair is given twice"),
        (
            {("rigid_1", "rigid_2"): 0.9, ("rigid_1", "total"): 0.9, ("rigid_2", "total"): -0.9},
            "film 'total' cannot correlate so with 'rigid_1', 'rigid_2': .* not positive semidefinite; bring those",
        ),
        ({("rigid_1", "rigid_2"): 1.0, ("rigid_1", "total"): 0.5}, "film 'total' cannot correlate so with"),
    ],
)
def test_films_that_cannot_scatter_so_together_are_refused(
    correlation: dict[tuple[str, str], float], message: str
) -> None:
    with pytest.raises(RangeError, match=f"^design 'common_base': scatter_correlation.*{message}"):
        replace(get_design("common_base"), scatter_correlation=correlation)


def test_films_may_scatter_as_one_and_a_film_may_not_scatter_at_all() -> None:
    common = get_design("common_base")
    as_one = replace(common, scatter_correlation=dict.fromkeys(common.scatter_correlation, 1.0))
    assert as_one.ratio_scatter == pytest.approx(abs((0.125 + 0.095) / 2 - 0.066), rel=1e-6)
    still = replace(common, films=tuple(replace(film, scatter=0.0) for film in common.films))
    assert still.ratio_scatter == 0.0
    with pytest.raises(RangeError, match=r"film 'rigid_1': its scatter -0\.1 is not from 0 to below 1"):
        replace(common, films=(replace(common.films[0], scatter=-0.1), *common.films[1:]))


def test_the_ratios_of_the_different_bases_are_those_of_table_5_7() -> None:
    table = read_table("5.7")
    assert get_design("different_base").thesis_force_ratio == dict(
        zip(table.rows, table.values("force_ratio").tolist(), strict=True)
    )
