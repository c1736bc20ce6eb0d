"""What people are shown of a study: a line for each group of cells, what failed, and where the files are."""

from __future__ import annotations

from typing import Any

import pytest

from palpate.procedures.study.results import Results, print_study
from palpate.procedures.study.run import BlockBuilder
from tests.procedures.studies import GRID, study_from

OUTCOME = {
    "study": "out",
    "points": "out/points.csv",
    "plot": "out/plot.png",
    "cells": 12,
    "done": 12,
    "failed": [],
    "one_by_one": {},
}


def point(ratio: float) -> dict[str, Any]:
    return {
        "load_N": 1.0, "force_ratio": ratio, "force_ratio_u": 0.01, "pickup_u": 0.0, "noise_u": 0.001,
        "degrees_of_freedom": None, "model_force_ratio": 0.3, "valid": True, "flags": [],
    }  # fmt: skip


def results(failed: int | None = None) -> Results:
    """Results of twelve cells, one of which may have failed."""
    study = study_from(GRID)
    ratios = [0.1 + 0.01 * cell for cell in range(len(study))]
    builder = BlockBuilder(0, len(study), 2)
    for cell, ratio in enumerate(ratios):
        builder.rows(cell, [point(ratio)] * 2)
    if failed is not None:
        builder.failed(failed, "reason")
    return Results(study, [builder.block()])


def told(capsys: pytest.CaptureFixture[str], failed_cell: int | None = None, **outcome: Any) -> str:
    print_study(results(failed_cell), {**OUTCOME, **outcome})
    return capsys.readouterr().out


def test_cells_that_differ_in_their_seeds_alone_are_one_line_with_their_mean_and_spread(
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = [line.split() for line in told(capsys).splitlines() if line.strip().startswith(("near", "far"))]
    assert [row[:3] for row in rows] == [["near", "1", "3"], ["near", "2", "3"], ["far", "1", "3"], ["far", "2", "3"]]
    first = [0.1 + 0.01 * cell for cell in (0, 2, 4)]  # the sample varies faster than the seed
    assert float(rows[0][3]) == pytest.approx(sum(first) / 3, rel=1e-3)
    assert float(rows[0][4]) == pytest.approx(0.02, rel=0.05)
    assert float(rows[0][-1]) == pytest.approx(0.3)


def test_each_number_of_a_group_stands_below_its_heading(capsys: pytest.CaptureFixture[str]) -> None:
    lines = told(capsys, failed_cell=0).splitlines()
    (heads,) = [line.split() for line in lines if line.split()[-1:] == ["model"]]
    row = next(line.split() for line in lines if line.strip().startswith("near"))
    assert heads[-6:] == ["cells", "failed", "ratio", "spread", "u", "model"]
    group = results(failed=0).groups()[0]
    assert row[-6:-4] == [str(group.cells), "1"]
    numbers = [group.force_ratio, group.spread, group.force_ratio_u, group.model_force_ratio]
    assert len(set(numbers)) == 4
    assert [float(text) for text in row[-4:]] == pytest.approx(numbers, rel=0.05)


def test_failures_and_files_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    failed = [{"cell": number, "reason": f"reason {number}"} for number in range(7)]
    shown = told(capsys, failed=failed)
    assert "cell 4 failed: reason 4" in shown and "cell 5 failed" not in shown
    assert "and 2 cells more failed: see --json" in shown
    assert "out, 12 of 12 cells" in shown and "out/points.csv" in shown and "out/plot.png" in shown
    assert "SIMULATED" in shown


def test_an_effect_that_keeps_cells_from_being_arrays_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert "one by one" not in told(capsys)
    shown = told(capsys, one_by_one={"mounting_scatter": 7})
    assert "7 cells were computed one by one, because of the effect mounting_scatter" in shown
