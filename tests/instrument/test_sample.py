from __future__ import annotations

import csv
import math
import statistics
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES, Sample, get_sample, parse_samples

THESIS = Path(__file__).parents[1] / "data" / "thesis"
SINGLE = get_design("single")


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


@pytest.mark.parametrize("text", ["", "1,", "0-3", "4-7", "1-1000000000000", "1--3", "x", "01-02", "²"])
def test_a_text_that_names_no_sample_is_refused(text: str) -> None:
    with pytest.raises(UnknownName, match="unknown sample"):
        parse_samples(text)


@pytest.mark.parametrize("text", ["1,1", "1-3,2", "3,1-6"])
def test_a_sample_named_twice_is_refused(text: str) -> None:
    with pytest.raises(RangeError, match="named twice"):
        parse_samples(text)


def test_a_backward_range_is_refused_with_the_forward_one() -> None:
    with pytest.raises(RangeError, match="write '1-3'"):
        parse_samples("3-1")


@pytest.mark.parametrize("text", ["1-", "-3", "-", "1,2-"])
def test_a_range_without_one_of_its_ends_is_refused(text: str) -> None:
    with pytest.raises(RangeError, match=r"sample range '.*-.*' lacks an end; write for example '1-3'"):
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
