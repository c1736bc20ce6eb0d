"""The designs and the samples: what their numbers must satisfy, and what the thesis says of them."""

from __future__ import annotations

import csv
import math
import statistics
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models.parameters import PHYSICAL, solid_parameters
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.sensor.designs import COMMON_BASE, DESIGNS, SINGLE, array_of, get_design
from palpate.instrument.sensor.sample import SAMPLES, Sample, get_sample, parse_samples
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


# --- The samples and the single design of the thesis ---------------------------------------------------

THESIS = Path(__file__).parents[1] / "data" / "thesis"


def table(name: str) -> list[dict[str, str]]:
    with (THESIS / name).open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_samples_have_the_repaired_moduli_of_the_thesis() -> None:
    printed = {row["sample"]: float(row["modulus_best_Pa"]) for row in table("sample_moduli_5_2_to_5_4.csv")}
    assert {name: sample.modulus for name, sample in SAMPLES.items()} == printed


def test_an_unknown_sample_is_refused_with_the_valid_names() -> None:
    with pytest.raises(UnknownName, match=r"sample '7'.*valid: 1, 2, 3, 4, 5, 6"):
        get_sample("7")


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("1-6", ("1", "2", "3", "4", "5", "6")),
        ("1,3,5-6", ("1", "3", "5", "6")),
        ("6, 2, 3 - 4", ("6", "2", "3", "4")),
        ("4", ("4",)),
        ("2-2", ("2",)),
    ],
)
def test_samples_are_read_in_the_order_written(text: str, names: tuple[str, ...]) -> None:
    assert parse_samples(text) == names


@pytest.mark.parametrize(
    ("texts", "error", "message"),
    [
        (["", "1,", "0-3", "4-7", "1-1000000000000", "1--3", "x", "01-02", "²"], UnknownName, "unknown sample"),
        (["1,1", "1-3,2", "3,1-6"], RangeError, "named twice"),
        (["3-1"], RangeError, "write '1-3'"),
        (["1-", "-3", "-", "1,2-"], RangeError, r"sample range '.*-.*' lacks an end; write for example '1-3'"),
    ],
)
def test_a_text_that_names_no_samples_is_refused(texts: list[str], error: type[Exception], message: str) -> None:
    for text in texts:
        with pytest.raises(error, match=message):
            parse_samples(text)


@pytest.mark.parametrize("field", ["modulus", "thickness", "area"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
def test_a_sample_needs_positive_finite_properties(field: str, value: float) -> None:
    properties = {"modulus": 24e3, "thickness": 3e-3, "area": 1e-4, field: value}
    with pytest.raises(RangeError, match=field):
        Sample(name="trial", material="rubber", poisson=0.3, source="a test", **properties)


@pytest.mark.parametrize("value", [-1.0, 0.500001, math.nan, -math.inf])
def test_a_poisson_ratio_outside_its_limits_is_refused(value: float) -> None:
    with pytest.raises(RangeError, match="Poisson"):
        replace(get_sample("1"), poisson=value)


def test_an_unknown_film_is_refused() -> None:
    with pytest.raises(UnknownName, match="film of design 'single'"):
        SINGLE.film("base")


def test_the_single_sensor_has_the_areas_of_the_appendix() -> None:
    assert SINGLE.tooth.area == pytest.approx(6.1575e-6, rel=1e-4)
    assert SINGLE.ring.area == pytest.approx(71.47e-6, rel=1e-4)
    assert SINGLE.gap == pytest.approx(0.1e-3)


def test_the_measured_ratios_are_the_averages_printed_in_the_thesis() -> None:
    printed = {
        row["sample"]: float(row["average_force_ratio"])
        for row in table("experiments_printed_averages_A2_9_to_A2_20.csv")
        if row["arrangement"] == "single"
    }
    assert SINGLE.thesis_force_ratio == printed


def test_the_softness_order_is_that_of_the_ratios_and_of_the_moduli() -> None:
    by_ratio = sorted(SAMPLES, key=lambda name: -SINGLE.thesis_force_ratio[name])
    by_modulus = sorted(SAMPLES, key=lambda name: -SAMPLES[name].modulus)
    assert tuple(by_ratio) == tuple(by_modulus) == SINGLE.thesis_softness_order


@pytest.mark.parametrize(
    ("film", "channel", "voltage", "force"),
    [("rigid", 1, "pvdf2_rigid_mV", "force_rigid_N"), ("total", 2, "pvdf1_total_mV", "force_total_N")],
)
def test_the_films_have_the_sensitivity_and_scatter_of_the_tables(
    film: str, channel: int, voltage: str, force: str
) -> None:
    rows = table("experiments_single_A2_9_to_A2_14.csv")
    sensitivity = [float(row[voltage]) * 1e-3 / float(row[force]) for row in rows]
    mean = statistics.mean(sensitivity)
    assert SINGLE.film(film).channel == channel
    assert SINGLE.film(film).sensitivity == pytest.approx(mean, rel=1e-4)
    assert SINGLE.film(film).scatter == pytest.approx(statistics.stdev(sensitivity) / mean, abs=5e-4)


def test_the_ratio_scatters_as_in_the_tables() -> None:
    ratios = defaultdict(list)
    for row in table("experiments_single_A2_9_to_A2_14.csv"):
        ratios[row["sample"]].append(float(row["force_rigid_N"]) / float(row["force_total_N"]))
    relative = [statistics.stdev(values) / statistics.mean(values) for values in ratios.values()]
    rms = math.sqrt(statistics.mean(value**2 for value in relative))
    assert SINGLE.ratio_scatter == pytest.approx(rms, abs=5e-4)


# --- The films of a design are complete: each tooth's film has a base's film, and no name, channel or tooth is wrong

RIGID, TOTAL = sorted(SINGLE.films, key=lambda film: film.name)


@pytest.mark.parametrize(
    ("films", "says"),
    [
        ((RIGID,), "film 'rigid': there must be a 'total' film that takes the force of its teeth, too"),
        ((TOTAL,), "has no film whose name begins with 'rigid'"),
        ((RIGID, TOTAL, replace(TOTAL, name="spare", channel=3)), "film 'spare': its name must begin with 'rigid' or"),
        ((RIGID, replace(TOTAL, channel=RIGID.channel)), "film 'rigid': its name, and its channel 1 from 1, must be"),
        ((replace(RIGID, channel=0), TOTAL), "film 'rigid': its name, and its channel 0 from 1, must be"),
        ((RIGID, TOTAL, replace(TOTAL, channel=3)), "film 'total': its name, and its channel"),
        ((RIGID, replace(TOTAL, teeth=(0, 1))), "film 'total': its teeth (0, 1) must be one or more of the numbers 0"),
        ((replace(RIGID, teeth=()), TOTAL), "film 'rigid': its teeth () must be one or more of the numbers 0 to 0"),
    ],
)
def test_films_that_give_no_force_ratio_are_refused(films: tuple[object, ...], says: str) -> None:
    with pytest.raises(RangeError) as caught:
        replace(SINGLE, films=films)  # type: ignore[arg-type]
    assert says in str(caught.value)
    assert str(caught.value).startswith("design 'single': ")


def test_a_film_under_a_tooth_needs_the_film_under_its_own_base() -> None:
    rigid = [film for film in COMMON_BASE.films if film.kind == "rigid"]
    (base,) = (film for film in COMMON_BASE.films if film.kind == "total")
    with pytest.raises(RangeError, match="'total' film that takes the force of its teeth"):
        replace(COMMON_BASE, films=(*rigid, replace(base, teeth=(0,))))
