"""Everything of chapters 4 and 5 beside ours: rows that are judged, kept solutions, one page, an exit status."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.findings.compression import compress
from palpate.instrument.findings.film_forces import ToothPoint
from palpate.instrument.models.evidence import Evidence, EvidencePart, ratio_by
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.oscilloscope import Distortion, ScopeReading
from palpate.instrument.thesis import TableCell, read_table
from palpate.instrument.uncertainty import budget
from palpate.procedures.measurements.load_cell.report import LoadCellPoint, LoadCellResult
from palpate.procedures.measurements.loads import LoadPoint, SweepResult, evaluate
from palpate.procedures.measurements.modulus import ModulusResult
from palpate.procedures.records.run import Run
from palpate.procedures.reproduce import chapter5, curves, everything, models
from palpate.procedures.reproduce.chapter5 import PointTraces, Traces, distortion_sentence, read_traces
from palpate.procedures.reproduce.criterion import LEAST_SHARE
from palpate.procedures.reproduce.curves import CurveCase, Solutions
from palpate.procedures.reproduce.page import Everything
from palpate.procedures.reproduce.rows import Row, RowTable
from tests.instrument.test_compression import three
from tests.procedures.conftest import Palpate

SINGLE, COMMON, DIFFERENT = chapter5.ARRANGEMENTS
MEANS = ratio_by("experiment")


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few trials, and an empty file for each plot."""
    monkeypatch.setattr(budget, "TRIALS", 2000)
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda _figure, path, **_: Path(path).touch())


def row(
    thesis: float,
    ours: float,
    u: float | None,
    measured: bool = True,
    reason: str = "",
    evidence: Evidence = Evidence.INPUT,
) -> Row:
    return Row("1", "force_ratio", TableCell(f"{thesis:g}", thesis, reason), ours, u, evidence, measured)


def swept(arrangement: chapter5.Arrangement, factor: float = 1.0) -> SweepResult:
    """What the thesis' mean ratios give under every load, its forces times a factor."""
    design = get_design(arrangement.design)
    count = len(design.teeth)
    bases = sum(film.kind == "total" for film in design.films)
    rigid = [film.sensitivity for film in design.films if film.kind == "rigid"]
    total = [film.sensitivity for film in design.films if film.kind == "total"]
    points = []
    for sample, ratio in design.thesis_force_ratio.items():
        for load in arrangement.loads:
            force = 1.029 * load * factor
            teeth = tuple(
                ToothPoint(
                    n + 1, ratio * force / count * rigid[n], ratio * force / count, force / bases * total[n % bases],
                    force / bases, ratio, 0.04 * ratio, 0.0,
                )
                for n in range(count)
            )  # fmt: skip
            points.append(
                LoadPoint(
                    sample, load, 1.81 + 10.3 * load, load, 0.05, sum(t.voltage_V for t in teeth), force * total[0],
                    ratio * force, force, ratio, 0.04 * ratio, 0.0, 1.0, True, teeth=teeth,
                )
            )  # fmt: skip
    return evaluate(points, design)


def traces(found: SweepResult) -> Traces:
    """What an oscilloscope shows of these loads; the films are clean."""
    of_load = 1.029 * THESIS_LOAD_CELL.sensitivity_mV_per_N
    clean = (Distortion(0.0, 1e-3, 0.5),) * 4
    return {(p.sample, p.load_N): PointTraces(ScopeReading(of_load * p.load_N, 0.1, 0.15), clean) for p in found.points}


def compared(arrangement: chapter5.Arrangement, found: SweepResult, by: EvidencePart = MEANS) -> list[RowTable]:
    """Every table of the arrangement beside this sweep."""
    return list(chapter5.compare_experiment(arrangement, found, traces(found), by))


def pressed(sample: str) -> ModulusResult:
    return ModulusResult(get_sample(sample), compress(*three(), THESIS_LOAD_CELL, 1e-4, 1e-6))


def weighed() -> LoadCellResult:
    """Table 5.1 itself."""
    table = read_table("5.1")
    points = [
        LoadCellPoint(0.0, 1, direction, float(load), float(load) * 9.80665e-3, cell.value, ())
        for direction in ("loading", "unloading")
        for load, cell in zip(table.rows, table.columns[f"reading_{direction}_mV"], strict=True)
    ]
    return LoadCellResult(THESIS_LOAD_CELL, points)


# --- rows ----------------------------------------------------------------------------------------------


def test_an_error_is_a_percentage_of_the_theory_and_of_the_experiment_whichever_is_ours() -> None:
    assert row(0.2, 0.25, None).errors() == pytest.approx((-20.0, -25.0))
    assert row(0.2, 0.25, None, measured=False).errors() == pytest.approx((25.0, 20.0))
    assert row(0.0, 0.25, None).errors() == (-100.0, None)


def test_a_row_is_within_two_standard_uncertainties_and_without_any_it_is_not_judged() -> None:
    assert [row(1.0, ours, 0.1).within for ours in (1.19, 1.21, 0.81, 0.79, math.nan)] == [
        True, False, True, False, False,
    ]  # fmt: skip
    assert row(1.0, 2.0, None).within is None


# --- experiments ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("arrangement", "cells"), [(SINGLE, 300), (COMMON, 438), (DIFFERENT, 60)])
def test_the_thesis_own_means_lie_within_the_scatter_of_its_cells(
    arrangement: chapter5.Arrangement, cells: int
) -> None:
    tables = compared(arrangement, swept(arrangement))
    assert [table.number for table in tables] == [*arrangement.tables.values(), arrangement.summary]
    judged = [row.within for table in tables for row in table.judged]
    assert len(judged) == cells
    assert sum(judged) / cells > LEAST_SHARE
    assert {row.evidence for table in tables for row in table.rows} == {Evidence.INPUT}
    assert "noise explains all of it: no effect of this scene distorts" in tables[-1].sentences[-1]
    assert tables[-1].sentences[0].startswith("softness order of ours, hard to soft: 1 > 6 > 4 > 3 > 5 > 2: right")


def test_a_row_outside_says_whose_scatter_it_is() -> None:
    """Forces of ours are 1.029 of the load, times the factor."""
    outside = {
        (table.number, r.row, r.quantity): r.because
        for table in compared(SINGLE, swept(SINGLE, 1.33))
        for r in table.rows
        if r.within is False
    }
    assert outside["A2.9", "1.5", "force_total_N"] == (
        "our cell: without scatter 1.5; the thesis +0 % (+0.0 of its scatter), ours +37 % (+8.2)"
    )
    assert all(because for (_, row, quantity), because in outside.items() if not quantity.startswith("meter"))


def test_a_wrong_order_of_softness_is_said() -> None:
    wrong = replace(swept(DIFFERENT), softness_order=["2", "1", "3", "4", "5", "6"])
    (table,) = compared(DIFFERENT, wrong)
    assert table.sentences[0].endswith("WRONG: the thesis' figure has 1 > 6 > 4 > 3 > 5 > 2")
    assert not chapter5.order_is_right(wrong, get_design("different_base"))


def test_the_order_of_figure_5_4_is_right_for_its_sensor() -> None:
    """It has sample 5 above 3, which by modulus is softer."""
    design, found = get_design("common_base"), swept(COMMON)
    as_printed = replace(found, softness_order=["1", "6", "4", "5", "3", "2"])
    assert chapter5.order_is_right(as_printed, design)
    assert chapter5.reversed_pairs(as_printed, design) == {}
    assert chapter5.order_is_right(found, design)
    assert chapter5.reversed_pairs(found, design) == {("5", "3"): "the thesis' means have it so"}


def test_table_5_1_is_its_own_and_its_line_stands_beside_the_printed_sensitivity() -> None:
    table = chapter5.calibration_rows(weighed())
    assert {r.difference for r in table.rows} == {0.0}
    assert [row.within for row in table.rows] == 16 * [True]
    assert "10.306 mV/N by the line; the printed 0.1053 mV/N is mV per gram-force, 10.74 mV/N" in table.sentences[0]


def test_a_modulus_of_60_kpa_is_not_that_of_sample_1_and_lies_below_its_catalogue() -> None:
    table = chapter5.compression_rows("5.2", "1", pressed("1"))
    assert {row.within for row in table.rows} == {False}
    assert [r.cell.reason[:12] for r in table.rows if r.cell.reason] == ["scan or thes"]
    catalogue = chapter5.catalogue_rows({"1": pressed("1")})
    assert [r.within for r in catalogue.rows] == [False, True, True, True, True]


def test_the_columns_of_table_5_8_do_not_share_a_definition() -> None:
    found = chapter5.percent_definitions()
    assert [re.search(r": percent of the (\w+)", said).group(1) for said in found.sentences] == [  # type: ignore[union-attr]
        "theory", "theory", "experiment", "experiment",
    ]  # fmt: skip
    # The thesis prints nothing of its two-dimensional model: that theory is our beam, fitted to this very column.
    assert {(row.by, row.evidence) for row in found.rows if "2D" in row.quantity} == {
        ("the thesis against beam", Evidence.FITTED)
    }
    assert {row.evidence for row in found.rows if "2D" not in row.quantity} == {Evidence.INPUT}


# --- kept solutions ------------------------------------------------------------------------------------


def test_a_kept_solution_is_what_the_model_gives() -> None:
    case, ratios = CurveCase("single", "axisymmetric", "identified"), (curves.LOWEST, curves.HIGHEST)
    middle = case.ring * math.sqrt(ratios[0] * ratios[1])  # the node in the middle
    shipped = Solutions.shipped()
    assert list(shipped.kept.values())
    found = shipped.of(case.parameters_at(middle), f"mesh {curves.ROUND_MESH}", lambda: pytest.fail("it is not kept"))
    assert found[0] == pytest.approx(curves.solve(case, middle, 1)[0], rel=1e-3)  # a mesh coarser, a tenth of the time


def test_every_solution_that_is_needed_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(curves, "solve", lambda *_: pytest.fail("not kept: palpate reproduce models --fresh"))
    made = curves.Curves(models.cases(models.SETS), solutions=Solutions.shipped())
    for case in models.cases(models.SETS):
        made.of(case)


def test_a_changed_design_is_solved_anew(tmp_path: Path) -> None:
    case = CurveCase("single", "axisymmetric", "identified")
    changed = replace(case.parameters_at(1e5), tooth_radius=1.3e-3)
    kept = Solutions({}, {})
    assert kept.of(case.parameters_at(1e5), "mesh 1", lambda: [1.0]) == [1.0]
    assert kept.of(changed, "mesh 1", lambda: [2.0]) == [2.0]
    again = Solutions(json.loads(kept.write(tmp_path).read_text(encoding="utf-8")))
    assert again.of(changed, "mesh 1", lambda: [3.0]) == [2.0]
    assert again.of(changed, "mesh 2", lambda: [3.0]) == [3.0]


# --- the oscilloscope ----------------------------------------------------------------------------------


def test_the_oscilloscope_reads_the_recorded_load_and_an_amplifier_that_clips_distorts_it(palpate: Palpate) -> None:
    assert palpate("sweep", "loads", "--scene", "overdriven", "--samples", "1,2", "--loads", "1.5 N, 3 N",
                   "--out", "run").status == 0  # fmt: skip
    design = get_design("single")
    found = read_traces(Path("run"), design, 10.0)
    assert [*found] == [("1", 1.5), ("1", 3.0), ("2", 1.5), ("2", 3.0)]
    for (_, load), seen in found.items():
        assert seen.load_mV.peak_to_peak == pytest.approx(10.306 * load, rel=3 * design.films[1].scatter)
    distorted = {where for where, seen in found.items() for one in seen.distortions if one.by_noise < 1e-4}
    assert distorted == {("2", 3.0)}
    said = distortion_sentence(design, {sample: seen for (sample, load), seen in found.items() if load == 3.0})
    assert re.search(r"rigid 1: 0\.\d+ \(0\.\d+\), 2: 13\.\d+ \(0\.\d+\)\*; total 1: .*more than noise explains", said)


# --- all of it -----------------------------------------------------------------------------------------


def test_what_is_measured_is_recorded_and_an_interruption_keeps_what_is_done(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(done: Everything, seed: int | None, _progress: object) -> None:
        table = RowTable("5.5", "one sensor", "", (row(1.0, 1.0, 0.1),))
        done.tables.append((table, table.write(done.models.folder)))
        with everything.recorded(done.models.folder, seed, "ideal", "sweep-loads") as session:
            session.record.point({"load_N": 1.0}, {}, session.bench.clock.now_ns())
        raise KeyboardInterrupt

    monkeypatch.setattr(everything, "run", run)
    said = palpate("reproduce", "--seed", "7", "--out", "half")
    assert said.status == 130
    assert "1 tables that were done are kept in half" in said.err
    recorded = Run.open(Path("half") / "1-sweep-loads-ideal")
    assert (recorded.status, recorded.simulated, recorded.header["seed"]) == ("complete", True, 7)
    assert [point["load_N"] for point in recorded.points()] == [1.0]


def test_bad_input_is_one_error(palpate: Palpate) -> None:
    assert palpate("reproduce", "--seed", "-1").status == 2
    Path("full").mkdir()
    (Path("full") / "file").touch()
    said = palpate("reproduce", "--out", "full")
    assert said.status == 2
    assert "full holds other files; choose a new or empty folder" in said.complaint
