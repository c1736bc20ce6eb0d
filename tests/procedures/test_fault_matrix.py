"""A cell of every third kind in the matrix of faults; `python -m tests.benchmarks faults` plays all of them."""

from __future__ import annotations

import itertools

import pytest

from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.can import CanFault
from palpate.simulators.faults.modbus import RtuFault, TcpFault
from tests.fault_matrix import ONCE, STAYS, Cell, cells, play
from tests.fault_procedures import PROCEDURES

pytestmark = pytest.mark.slow

SWEEP, CALIBRATE = "sweep loads", "calibrate load-cell"

KNOWN = {
    Cell(SWEEP, "no_reply", "signal_generator", ONCE): "right",
    Cell(SWEEP, "power_cycle", "signal_generator", ONCE): "right",
    Cell(SWEEP, "node_reboot", "sensor_node_1", ONCE): "right",
    Cell(SWEEP, "bridge_open", "strain_indicator", ONCE): "right",
    Cell(SWEEP, "saturated_film", "sensor_node_1", STAYS): "marked",
    Cell(SWEEP, "over_temperature", "shaker_amplifier", ONCE): "stopped",
    Cell(SWEEP, "stuck_reading", "strain_indicator", STAYS): "stopped",
    Cell(SWEEP, "zero_drift", "strain_indicator", STAYS): "stopped",
    Cell(CALIBRATE, "not_a_number", "strain_indicator", STAYS): "stopped",
    Cell("test modulus", "zero_drift", "strain_indicator", STAYS): "stopped",
}


def chosen() -> list[Cell]:
    """One cell of every third kind, each procedure in its turn; of those waited for in vain, one that passes."""
    kinds = [kind for kind in FAULTS if kind not in {cell.kind for cell in KNOWN}][::3]
    found = []
    for number, (kind, procedure) in enumerate(zip(kinds, itertools.cycle(PROCEDURES), strict=False)):
        short = issubclass(fault_class(kind), (TcpFault, RtuFault, CanFault))
        of_kind = [cell for cell in cells() if (cell.kind, cell.procedure) == (kind, procedure)]
        able = [cell for cell in of_kind if not (short and cell.lasts == STAYS)]
        found.append(able[number % len(able)])
    return found


def test_the_matrix_has_every_fault_on_everything_that_can_have_it_in_every_procedure() -> None:
    whole = list(cells())
    assert len({cell.name for cell in whole}) == len(whole)
    assert {cell.kind for cell in whole} == set(FAULTS)
    assert {cell.procedure for cell in whole} == {cell.procedure for cell in chosen()} == set(PROCEDURES)
    assert {cell.on for cell in whole} == {
        "signal_generator", "shaker_amplifier", "strain_indicator", "positioner", "sample_changer", "line", "can",
        "sensor_node_1",
    }  # fmt: skip


@pytest.mark.parametrize("cell", chosen(), ids=lambda cell: cell.name)
def test_a_fault_ends_in_a_right_result_a_mark_or_a_clear_stop_with_outputs_at_zero(
    cell: Cell, nothing_left_behind: None
) -> None:
    outcome = play(cell)
    assert outcome.verdict in ("right", "marked", "stopped"), outcome.said


@pytest.mark.parametrize(("cell", "verdict"), KNOWN.items(), ids=lambda each: getattr(each, "name", each))
def test_what_can_be_made_good_is_and_what_cannot_is_marked_or_stops(cell: Cell, verdict: str) -> None:
    outcome = play(cell)
    assert outcome.verdict == verdict, outcome.said
    assert outcome.incidents or verdict != "right"
