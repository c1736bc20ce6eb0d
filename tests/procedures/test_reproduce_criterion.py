"""What `palpate reproduce` asks of each class of rows, the biases that it looks for, and Table 5.8 from our bench."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.instrument.models.evidence import Evidence, ratio_by
from palpate.instrument.thesis import read_table
from palpate.procedures.reproduce import chapter4, chapter5, everything
from palpate.procedures.reproduce.chapter5 import quantities
from palpate.procedures.reproduce.criterion import all_means, judge
from palpate.procedures.reproduce.curves import Curves
from palpate.procedures.reproduce.page import Everything
from palpate.procedures.reproduce.rows import (
    Comparison,
    ModelSeries,
    Row,
    RowTable,
    column_of,
    counts,
)
from tests.procedures.conftest import Palpate
from tests.procedures.test_reproduce_all import COMMON, DIFFERENT, SINGLE, compared, quick, row, swept

__all__ = ["quick"]  # few trials, used by name

INPUT, FITTED, PREDICTED = Evidence


def table(*rows: Row, number: str = "5.5", again: bool = False) -> RowTable:
    return RowTable(number, "one sensor", "", rows, again=again)


def rows(count: int, outside: int, evidence: Evidence) -> list[Row]:
    """One row for each load; those outside are off to both sides."""
    off = [0.3 * (-1) ** n if n < outside else 0.0 for n in range(count)]
    return [replace(row(1.0, 1.0 + o, 0.1, evidence=evidence), row=str(n)) for n, o in enumerate(off)]


# --- biases --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("factor", "biased"), [(0.85, True), (1 / 1.029, False), (1.15, True)])
def test_forces_that_are_off_in_the_mean_are_biased_though_each_cell_may_lie_within(
    factor: float, biased: bool
) -> None:
    """The thesis' own base films tell of 1.11 times the set load: ours, at the set load, are not off for that."""
    tables = compared(DIFFERENT, swept(DIFFERENT, factor))
    found = judge(tables)[INPUT].biased
    assert [mean.kind for mean in found] == (["forces and voltages"] if biased else [])
    assert all(math.copysign(1, mean.mean) == math.copysign(1, factor - 1 / 1.029) for mean in found)
    assert "1.111 times the set load in the mean, more than its loads scatter" in tables[-1].sentences[1]


def test_biases_are_told_beside_what_chance_would_put_there() -> None:
    found, by = [replace(each, ours=1.1) for each in rows(100, 0, INPUT)], rows(100, 0, INPUT)
    (biased, told), (fair, farthest) = (judge([table(*each)])[INPUT].sentences()[-2:] for each in (found, by))
    assert biased == (
        "means over a table or arrangement: 1 of 1 farther off than 2.0 of their standard deviations, which chance"
        " exceeds once in 20 runs"
    )
    assert told.startswith("BIASED: Table 5.5, force_ratio: +1.00 standard uncertainties of a row, in its own unit")
    assert told.endswith("95 % of such means are within ± 0.20, and this is 10.0 standard deviations off")
    assert ("none of 1 farther off" in fair, farthest[:18]) == (True, "the farthest mean:")


def test_a_bias_that_hides_in_every_table_is_found_over_all_of_an_arrangement() -> None:
    found = judge(compared(SINGLE, swept(SINGLE, 0.95 / 1.029)))[INPUT]
    assert [mean.of for mean in found.biased] == ["all tables of single"]
    assert not judge(compared(SINGLE, swept(SINGLE, 1 / 1.029)))[INPUT].biased


def test_what_every_table_shares_does_not_average_out_over_an_arrangement() -> None:
    means = all_means(compared(SINGLE, swept(SINGLE)))
    assert {mean.kind for mean in means if "all tables of" in mean.of} == {
        "force_ratio", "forces and voltages", "oscilloscope_mV",
    }  # fmt: skip
    assert {mean.u for mean in means if mean.kind == "meter_reading_mV"} == {1.0}


# --- the classes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("found", "met"),
    [
        (rows(100, 0, INPUT), True),
        (rows(100, 7, INPUT), True),
        (rows(100, 8, INPUT), False),
        ([replace(each, ours=1.1) for each in rows(100, 0, INPUT)], False),  # each within, all of them high
        ([*rows(99, 0, INPUT), row(1.0, math.nan, 0.1, evidence=INPUT)], False),
        (rows(100, 1, FITTED), False),
        (rows(100, 100, PREDICTED), True),
        ([*rows(99, 0, PREDICTED), row(1.0, math.nan, 0.1, evidence=PREDICTED)], False),
        ([*rows(99, 0, PREDICTED), row(1.0, math.nan, math.nan, evidence=PREDICTED)], False),
        ([*rows(900, 0, INPUT), *rows(100, 1, FITTED)], False),
    ],
)
def test_each_class_is_held_to_its_own_and_the_exit_status_says_so(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch, found: list[Row], met: bool
) -> None:
    def run(done: Everything, _seed: int | None, _progress: object) -> None:
        whole = table(*found)
        done.tables.append((whole, whole.write(done.models.folder)))

    monkeypatch.setattr(everything, "run", run)
    said = palpate("reproduce", "--json")
    told = "palpate: note: measuring every experiment and drawing every figure takes about 18 s\n"
    assert (said.status, said.err) == (0 if met else 1, told)
    answer = json.loads(said.out)
    assert answer.keys() == {
        "folder", "page", "evidence", "softness_order_right", "softness_order_evidence", "blind", "met", "outside",
        "tables", "models",
    }  # fmt: skip
    assert answer["met"] is met is all(one["met"] for one in answer["evidence"].values())
    assert list(answer["evidence"]) == ["input", "fitted", "predicted"]
    assert sum(one["rows"] for one in answer["evidence"].values()) == len(found)
    with (Path(answer["folder"]) / "table_5_5.csv").open(encoding="utf-8", newline="") as file:
        assert [line["evidence"] for line in csv.DictReader(file)] == [each.evidence.value for each in found]


def test_a_class_is_counted_alone_and_a_number_that_is_printed_twice_once() -> None:
    mixed = table(*rows(10, 1, INPUT), *rows(20, 0, FITTED), *rows(30, 20, PREDICTED), number="A2.1")
    twice = judge([mixed, replace(mixed, number="4.1", again=True)])
    assert {each: (v.count.judged, v.count.within, v.share) for each, v in twice.items()} == {
        INPUT: (10, 9, 0.9), FITTED: (20, 20, 1.0), PREDICTED: (30, 10, pytest.approx(1 / 3)),
    }  # fmt: skip
    assert [str(count) for count in counts(mixed).values()] == ["9 of 10", "20 of 20", "10 of 30"]


def test_rows_that_no_theory_can_miss_are_told_apart() -> None:
    """Under an object much harder than the ring every ratio tends to 1."""
    hard = [replace(each, telling=False, by="solid, physical") for each in rows(10, 0, PREDICTED)]
    verdict = judge([table(*hard, *(replace(each, by="solid, physical") for each in rows(10, 9, PREDICTED)))])[
        PREDICTED
    ]
    assert verdict.counted() == (
        "11 of 20 rows lie within their stated scatter, 55.0% (1 of 10 where the force ratio is below 0.9)"
    )
    assert "solid, physical: 11 of 20 rows, 55.0% (1 of 10 where the force ratio is below 0.9)" in verdict.sentences()
    assert verdict.record()["by"] == {
        "solid, physical": {"rows": 20, "judged": 20, "within": 11, "telling": 10, "telling_within": 1}
    }


def test_rows_that_a_fit_brings_with_it_are_told_apart() -> None:
    """Tables of the stiffer ring are those of the other one at the same ratio of moduli: no second test of a fit."""
    brought = [replace(each, follows=True) for each in rows(6, 0, PREDICTED)]
    verdict = judge([table(*rows(4, 3, PREDICTED), *brought)])[PREDICTED]
    assert (verdict.count.within, verdict.count.judged) == (7, 10)
    (said,) = verdict.following()
    assert said.startswith("without 6 rows that follow from a fit") and said.endswith("1 of 4, 25.0%")
    assert said in verdict.sentences() and said in verdict.brief()
    assert verdict.record()["follows"] == {"judged": 6, "within": 6}
    assert judge([table(*rows(4, 3, PREDICTED))])[PREDICTED].following() == []


def test_what_follows_from_a_fit_is_where_the_other_rings_table_has_the_row() -> None:
    """14.9 to 20 kPa on the ring of 33 kPa are softer, beside it, than anything on that of 24 kPa."""
    stiff = read_table("A2.2")
    ratios = {(name, "axisymmetric"): abs(stiff.values("force_rigid_N")) for name in ("physical", "identified")}
    compared = Comparison(stiff, (column_of(stiff, "force_rigid_N", ratios, 0.012),), ()).row_table().rows
    tested_anew = [each.row for each in compared if each.by.endswith("identified") and not each.follows]
    assert [float(key) for key in tested_anew] == [14.9e3, 16.6e3, 18.3e3, 20e3]
    assert not any(each.follows for each in compared if each.by.endswith("physical"))


def test_rows_without_a_stated_scatter_are_told_with_how_far_they_are() -> None:
    volts = [replace(row(1e-3, ours, None, evidence=PREDICTED), quantity="voltage_pvdf2_V") for ours in (0.5, 0.6, 0.7)]
    verdict = judge([table(*rows(10, 0, PREDICTED), *volts)])[PREDICTED]
    assert (
        "not judged, as no scatter is stated: 3 rows of voltage, of which the median is 600 times the thesis'"
        in verdict.sentences()
    )
    assert verdict.record()["unjudged"] == {"voltage": {"rows": 3, "factor": pytest.approx(600)}}


def test_rows_outside_are_told_beside_what_chance_would_put_there() -> None:
    off = [*[0.5] * 98, 2.2, -2.5]
    (said,) = [
        line
        for line in judge([table(*(row(1.0, 1.0 + z * 0.1, 0.1) for z in off), row(1.0, 9.0, None))])[INPUT].sentences()
        if "outside" in line
    ]
    assert said == (
        "2 rows lie outside, the farthest by 2.5 standard uncertainties; of 100 normally distributed differences chance"
        " puts 5 outside, and the farthest at about 2.8"
    )


# --- what went in does not scatter about itself --------------------------------------------------------


@pytest.mark.parametrize(("arrangement", "number"), [(SINGLE, "A2.9"), (COMMON, "A2.15"), (DIFFERENT, "5.7")])
def test_a_mean_that_went_in_is_met_to_our_own_uncertainty_and_a_predicted_one_to_both(
    arrangement: chapter5.Arrangement, number: str
) -> None:
    def mean(by: str) -> Row:
        tables = compared(arrangement, swept(arrangement), ratio_by(by))
        chosen = next(each for each in tables if each.number == number)
        return next(each for each in chosen.rows if each.kind == "mean force ratio")

    ours = next(each for each in swept(arrangement).samples if each.sample == "1")
    given, predicted = mean("experiment"), mean("solid")
    assert (given.evidence, given.u) == (INPUT, ours.force_ratio_u)
    assert (predicted.evidence, (predicted.u or 0) > (given.u or 0)) == (PREDICTED, True)


def test_the_cells_of_table_5_7_are_the_means_that_went_in() -> None:
    def ratio(by: str) -> float:
        (found,) = compared(DIFFERENT, swept(DIFFERENT), ratio_by(by))
        return next(each.u or 0 for each in found.rows if each.kind == "force_ratio")

    assert ratio("solid") == pytest.approx(math.sqrt(2) * ratio("experiment"), rel=1e-6)


@pytest.mark.parametrize(
    ("design", "expected"),
    [
        ("single", {"pvdf2_rigid_mV": 5.995 * 0.75, "pvdf1_total_mV": 68.60 * 3}),
        ("common_base", {"pvdf1_mV": 7.013 * 0.375, "pvdf2_mV": 6.506 * 0.375, "pvdf3_total_mV": 23.53 * 3}),
        ("different_base", {"pvdf1_mV": 5.675 * 0.375, "pvdf2_total_left_mV": 63.66 * 1.5,
                            "pvdf3_mV": 5.692 * 0.375, "pvdf4_total_right_mV": 64.21 * 1.5}),
    ],
)  # fmt: skip
def test_without_scatter_a_film_gives_its_own_sensitivity_times_its_share_of_the_force(
    design: str, expected: dict[str, float]
) -> None:
    found = {each.column: each.expected(3.0, 0.25) for each in quantities(chapter4.get_design(design), {}, ())}
    assert {name: value for name, value in found.items() if name.endswith("_mV")} == pytest.approx(
        {**expected, "meter_reading_mV": math.nan}, rel=1e-12, nan_ok=True
    )


# --- Table 5.8 -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def theories() -> Comparison:
    """Table 5.8 by the models, each theory half the thesis' mean ratio."""

    def half(_curves: object, design: str, *_: object) -> np.ndarray:
        measured = chapter4.get_design(design).thesis_force_ratio
        return np.array([measured[sample] / 2 for sample in "123456"])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chapter4, "ratios", half)
        return chapter4.compare_theories(("physical", "identified"), Curves([]))


def bench_table(theories: Comparison) -> RowTable:
    return chapter5.percent_of_bench(theories, {each.design: swept(each) for each in chapter5.ARRANGEMENTS})


def found_of(theories: Comparison) -> Callable[[str], list[Row]]:
    rows = bench_table(theories).rows
    return lambda quantity: [each for each in rows if each.quantity == quantity]


def test_an_experiment_above_its_theory_has_a_positive_error_of_the_thesis_own_definition(theories: Comparison) -> None:
    of = found_of(theories)
    assert {round(each.ours, 9) for each in of("single_vs_3D_percent")} == {100.0}  # of the theory
    assert {round(each.ours, 9) for each in of("single_vs_2D_percent")} == {100.0}
    assert {round(each.ours, 9) for each in of("common_base_vs_3D_percent")} == {50.0}  # of the experiment
    assert {round(each.ours, 9) for each in of("different_base_vs_3D_percent")} == {50.0}
    assert [each.row for each in of("common_base_vs_3D_percent")[:7]] == [*"123456", "average"]


def test_table_5_8_names_its_models_and_what_they_are_worth(theories: Comparison) -> None:
    of = found_of(theories)
    seen = {(each.by, each.evidence) for name in chapter4.THEORIES for each in of(f"{name}_percent")}
    assert seen == {
        ("bench against axisymmetric, physical", PREDICTED), ("bench against axisymmetric, identified", FITTED),
        ("bench against solid, physical", PREDICTED), ("bench against solid, identified", FITTED),
        ("bench against beam, physical", FITTED), ("bench against beam_printed, physical", PREDICTED),
    }  # fmt: skip


def test_averages_are_told_by_model_and_class_beside_the_thesis_own(theories: Comparison) -> None:
    said = bench_table(theories).sentences
    assert "positive where the experiment lies above" in said[0]
    assert (
        "single_vs_3D, average: +100.0 % by axisymmetric, identified (fitted), the thesis -9.62 %, without its slip"
        " -11.2 %" in said
    )
    assert "common_base_vs_3D, average: +50.0 % by solid, physical (predicted), the thesis 23.64 %" in said
    assert row(1.0, 2.0, None).errors() != (None, None)
    assert {each.errors() for each in bench_table(theories).rows} == {(None, None)}


def test_a_percentage_from_the_slipped_column_is_repaired_and_no_other(theories: Comparison) -> None:
    of = found_of(theories)
    repaired = {
        (each.quantity, each.row): (each.cell.printed, round(each.cell.value, 1))
        for name in chapter4.THEORIES
        for each in of(f"{name}_percent")
        if "shifted column" in each.cell.reason
    }
    assert repaired == {
        ("single_vs_3D_percent", "1"): ("-5.7", -10.6),
        ("single_vs_3D_percent", "6"): ("-12.8", -17.5),
        ("single_vs_3D_percent", "average"): ("-9.62", -11.2),
    }


def test_the_corrected_beam_is_within_the_goal_of_its_fit_and_the_printed_program_is_not() -> None:
    class Nothing(Curves):
        def of(self, case: object) -> object:  # type: ignore[override]
            raise AssertionError("the beam needs no finite elements")

    columns = {"single_vs_2D": chapter4.THEORIES["single_vs_2D"]}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chapter4, "THEORIES", columns)
        compared = chapter4.compare_theories(("physical",), Nothing([])).row_table()
    judged = {each.by: [r.within for r in compared.judged if r.by == each.by] for each in compared.judged}
    assert judged == {"beam, physical": 6 * [True], "beam_printed, physical": 6 * [False]}


def test_a_series_is_named_by_model_and_set() -> None:
    assert ModelSeries("physical", "beam", np.zeros(1)).name == "physical_beam"
