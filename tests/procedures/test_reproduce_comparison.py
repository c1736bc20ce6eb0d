"""How a table of the thesis and a model are compared, and what is said of it."""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from palpate.instrument.thesis import TableCell, ThesisTable, read_table
from palpate.procedures.reproduce import chapter4
from palpate.procedures.reproduce.curves import CurveCase
from palpate.procedures.reproduce.rows import ComparedColumn, Comparison, ModelSeries, fit_sentence

IDENTIFIED = CurveCase("single", "axisymmetric", "identified")


def small(ours: list[float], thesis: tuple[float, ...] = (0.2, -0.4), goal: float | None = 0.015) -> Comparison:
    """A table of two rows, the second repaired."""
    cells = (TableCell("0.2", thesis[0]), TableCell("0.44", thesis[1], "thesis slip"))
    table = ThesisTable("9.9", "trial", "sample", ("1", "2"), MappingProxyType({"force_ratio": cells}))
    series = (ModelSeries("physical", "solid", np.array(ours)),)
    return Comparison(table, (ComparedColumn("force_ratio", cells, series, goal),), ())


def test_a_difference_is_ours_less_the_repaired_value_of_the_thesis() -> None:
    first, second = small([0.21, 0.37]).records()
    assert first == {
        "sample": "1", "quantity": "force_ratio", "printed": "0.2", "thesis": 0.2, "repaired": "",
        "physical_solid": 0.21, "physical_solid_evidence": "predicted",
        "physical_solid_difference": pytest.approx(0.01),
        "physical_solid_relative_difference": pytest.approx(0.05),
        "physical_solid_relative_to_ours": pytest.approx(0.05 / 1.05),
    }  # fmt: skip
    assert (second["printed"], second["thesis"], second["repaired"]) == ("0.44", 0.4, "thesis slip")
    assert second["physical_solid_difference"] == pytest.approx(-0.03)


def test_a_deviation_is_the_worst_cell_the_rms_and_the_cells_within_the_goal() -> None:
    """A cell without an answer is left out."""
    (deviation,), (other,) = small([0.21, 0.37]).deviations(), small([math.nan, 0.37]).deviations()
    assert (deviation.worst, deviation.worst_at) == (pytest.approx(-0.03), "2")
    assert deviation.rms == pytest.approx(math.sqrt((0.01**2 + 0.03**2) / 2))
    assert deviation.factor == pytest.approx((1.05 + 0.925) / 2)
    assert (deviation.cells, deviation.within, deviation.goal) == (2, 1, 0.015)
    assert (other.cells, other.within, other.rms) == (1, 0, pytest.approx(0.03))
    first, _ = small([math.nan, 0.37]).records()
    assert first["physical_solid"] is first["physical_solid_difference"] is None


def test_the_sentence_says_what_matches_and_what_does_not() -> None:
    missed, met = (fit_sentence(small(ours), "force_ratio") for ours in ([0.21, 0.37], [0.21, 0.401]))
    assert missed == (
        "force_ratio: physical set by solid: does not match: 1 of 2 cells within 0.015, worst -0.0300 at sample 2,"
        " rms 0.0224"
    )
    assert "meets all of 2 cells within 0.015, worst +0.0100 at sample 1" in met


def test_a_copied_table_is_called_a_copy_and_one_that_differs_is_not() -> None:
    table, twin = read_table("A2.5"), read_table("A2.3")
    assert chapter4.twin_sentence(table, twin).startswith(
        "240 of 240 cells, repaired, are those of Table A2.3: it is a copy"
    )
    other = replace(twin, columns={**twin.columns, "force_ratio": table.columns["force_pvdf1_N"]})
    said = chapter4.twin_sentence(table, other)
    assert said.startswith("192 of 240 cells")
    assert said.endswith("the two are not independent")


def test_both_definitions_of_the_error_give_back_the_percentage() -> None:
    experiment, percent = np.array([0.3, 0.2]), np.array([20.0, -5.0])
    of_theory, of_experiment = (chapter4.rebuilt(experiment, percent, flag) for flag in (False, True))
    assert 100 * (experiment - of_theory) / of_theory == pytest.approx(percent)
    assert 100 * (experiment - of_experiment) / experiment == pytest.approx(percent)


@pytest.mark.parametrize(("column", "limit"), [("single_vs_3D", 3e-3), ("common_base_vs_3D", 1.2e-3)])
def test_table_5_8_is_about_the_printed_averages_and_tables_a2_1_and_a2_3(column: str, limit: float) -> None:
    *_, source, of_experiment = chapter4.THEORIES[column]
    assert source is not None
    taken = chapter4.implied(column)[chapter4.OF_EXPERIMENT if of_experiment else chapter4.OF_THEORY]
    printed = chapter4.table_ratio(source, chapter4.sample_moduli(), printed=True)
    assert np.sqrt(np.mean((taken - printed) ** 2)) < limit
