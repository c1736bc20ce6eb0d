"""A study file: its grid, its draws, and what is refused of it with the nearest name."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.instrument.errors import ConfigError
from palpate.procedures.study.description import MOST_CELLS, read_study
from palpate.procedures.study.results import coordinate
from tests.procedures.studies import GRID, RANDOM, study_from


def test_a_grid_has_every_combination_and_the_last_axis_goes_fastest() -> None:
    study = study_from(GRID.replace('sample = ["1", "2"]', 'sample = "1-4"'))
    assert len(study) == 24
    assert study.cell(0) == {"scene": "near", "seed": 1, "sample": "1"}
    assert study.cell(7) == {"scene": "near", "seed": 2, "sample": "4"}
    assert study.cell(12) == {"scene": "far", "seed": 1, "sample": "1"}
    assert len({tuple(study.varied(i).items()) for i in range(24)}) == 24


def test_draws_lie_in_their_ranges_and_do_not_depend_on_how_many_there_are() -> None:
    study, fewer = study_from(RANDOM), study_from(RANDOM.replace("cells = 40", "cells = 4"))
    assert [fewer.cell(i) for i in range(4)] == [study.cell(i) for i in range(4)]
    assert study.cell(0) != study_from(RANDOM.replace("seed = 5", "seed = 6")).cell(0)
    cells = [study.varied(i) for i in range(40)]
    moduli, unit = coordinate([cell["modulus"] for cell in cells])
    numbers = [float(value) for value in moduli]
    assert unit == "kPa"
    assert all(10 <= value <= 1000 for value in numbers)
    assert 10 < sum(value < 100 for value in numbers) < 30  # half of them, by the logarithm
    assert all(0.25 <= float(cell["effects.glue_clamping.factor"]) <= 0.5 for cell in cells)
    assert {cell["model"] for cell in cells} == {"column", "beam"}


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('name = "grid"', "", "name: is missing"),
        ("loads", "load", r"load: unknown key \(did you mean 'loads'\?\)"),
        ('"1 N, 2 N"', '"10 N"', "load 10 N peak to peak takes a peak force"),
        ("sample =", "smaple =", r"axes.smaple: unknown axis 'smaple' \(did you mean 'sample'\?\)"),
        ('sample = ["1", "2"]', 'sample = ["1", "7"]', "axes.sample: unknown sample '7'"),
        ('sample = ["1", "2"]', 'design = ["singel"]', r"axes.design: unknown design 'singel' \(did you mean 'single'"),
        ('sample = ["1", "2"]', "sample = []", r"axes.sample: \[\] is no list of values"),
        ('sample = ["1", "2"]', 'sample = ["1", "1"]', "axes.sample: a value is given twice"),
        ('sample = ["1", "2"]', 'modulus = ["-1 kPa"]', "axes.modulus: '-1 kPa' is no modulus"),
        ('sample = ["1", "2"]', 'modulus = { low = "1 kPa", high = "2 kPa" }', "axes.modulus: a range is drawn from"),
        ('"1-3"', '"3-1"', "axes.seed: seeds '3-1' run backwards"),
        ('"1-3"', '"1-10000000"', f"40000000 cells of 2 loads are more than the {MOST_CELLS} cells"),
        ('"1-3"', "[-1]", "axes.seed: -1 is no seed"),
        ('name = "grid"', 'name = "g"\nhow = "fast"', "how: 'fast' is not known; valid: 'closed form' or 'bench'"),
    ],
)  # fmt: skip
def test_what_is_no_study_is_refused(old: str, new: str, complaint: str) -> None:
    assert old in GRID
    with pytest.raises(ConfigError, match=f"^study.toml: {complaint}"):
        study_from(GRID.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('low = "10 kPa"', 'low = "2000 kPa"', "does not increase"),
        ('low = "10 kPa"', 'low = "10 Pa"', "has two units"),
        ('low = "10 kPa"', 'lwo = "10 kPa"', r"lwo: unknown key \(did you mean 'low'\?\)"),
        ('low = "10 kPa"', 'low = "0 kPa"', "above 0 where its scale is 'log'"),
        ('["column", "beam"]', '{ low = "a", high = "b" }', "has no range to draw from"),
    ],
)
def test_what_cannot_be_drawn_from_is_refused(old: str, new: str, complaint: str) -> None:
    assert old in RANDOM
    with pytest.raises(ConfigError, match=complaint):
        study_from(RANDOM.replace(old, new))


def test_the_example_is_a_study() -> None:
    assert len(read_study(Path(__file__).parents[1] / "examples" / "study.toml")) == 120
