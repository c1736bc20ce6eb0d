"""`calibrate load-cell --class`: what no run can mend is refused before anything moves, with what would do."""

from __future__ import annotations

import pytest

from palpate.instrument.calibration.load_cell_fit import STANDARD_GRAVITY, THESIS_LOAD_CELL
from palpate.instrument.errors import RangeError, UnknownName
from palpate.procedures.measurements.load_cell.report import _reached
from palpate.procedures.measurements.load_cell.wanted_class import POSITIONS, class_series
from tests.procedures.conftest import Palpate

WEIGHTS = tuple(1e-3 * m * STANDARD_GRAVITY for m in range(300, 1001, 100))
FINE = THESIS_LOAD_CELL.model_copy(update={"resolution_mV": 0.05})


def test_a_step_that_is_too_large_binds_and_the_best_class_is_named() -> None:
    planned = class_series("1", WEIGHTS, 1, (0.0,), FINE)
    assert (planned.runs, planned.further, planned.positions, planned.loads) == (2, 1, POSITIONS, WEIGHTS)
    with pytest.raises(RangeError, match="resolution binds") as refused:
        class_series("0.5", WEIGHTS, 2, POSITIONS, FINE)
    said = str(refused.value)
    assert "a step of the indicator, 0.05 mV, is 0.0989 % of 4.903 N" in said
    assert "best now  --class 1" in said
    assert "an indicator with steps of 0.025 mV or less" in said
    assert "loads up to 19.41 N or more" in said


@pytest.mark.parametrize(
    ("loads", "runs", "positions", "message"),
    [
        (WEIGHTS[1:], 2, POSITIONS, "8 loads, not 7"),
        (tuple(5.0 + 0.1 * n for n in range(8)), 2, POSITIONS, "a load of 50% of the greatest or less"),
    ],
)
def test_what_the_standard_asks_for_is_said(
    loads: tuple[float, ...], runs: int, positions: tuple[float, ...], message: str
) -> None:
    with pytest.raises(RangeError, match=message):
        class_series("1", loads, runs, positions, FINE)


def test_no_other_class_is_known() -> None:
    with pytest.raises(UnknownName, match="unknown class of ISO 376 '3'"):
        class_series("3", WEIGHTS, 2, POSITIONS, FINE)


def test_a_better_class_than_was_wanted_is_enough() -> None:
    found = THESIS_LOAD_CELL.iso_376.model_copy(update={"name": "0.5"})
    assert [_reached(found, name) for name in ("1", "0.5")] == ["reached", "reached"]
    assert _reached(found, "00").startswith("NOT REACHED")


def test_the_command_refuses_what_this_bench_cannot_give(palpate: Palpate) -> None:
    words = ("--loads", "300 gf:1000 gf:100 gf", "--runs", "2", "--positions", "0,120,240", "--class", "2")
    said = palpate("calibrate", "load-cell", *words)
    assert said.status == 2
    assert "resolution binds" in said.complaint
    assert "best now  no class" in said.complaint
