"""A cell of every third kind in the matrix of faults; `python -m tests.benchmarks faults` plays all of them."""

from __future__ import annotations

import itertools

import pytest

from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.can import CanFault
from palpate.simulators.faults.modbus import RtuFault, TcpFault
from tests.fault_matrix import ONCE, PROCEDURES, STAYS, Cell, Scenes, cells, play, real_bench, scene
from tests.procedures.test_makers_devices import MORE, PLAIN

pytestmark = pytest.mark.slow

SWEEP, CALIBRATE = "sweep loads", "calibrate load-cell"


def with_devices(kind: str) -> Scenes:
    """The scenes of the matrix, in which devices of a maker stand in for ours."""
    return lambda procedure: scene(procedure).with_devices((PLAIN | MORE)[kind])


BENCHES: dict[str, Scenes] = {
    "": scene,
    "real_bench": real_bench,
    **{kind: with_devices(kind) for kind in PLAIN | MORE},
}
KNOWN = {
    "": [
        (Cell(SWEEP, "no_reply", "signal_generator", ONCE), "right"),
        (Cell(SWEEP, "power_cycle", "signal_generator", ONCE), "right"),
        (Cell(SWEEP, "node_reboot", "sensor_node_1", ONCE), "right"),
        (Cell(SWEEP, "bridge_open", "strain_indicator", ONCE), "right"),
        (Cell(SWEEP, "saturated_film", "sensor_node_1", STAYS), "marked"),
        (Cell(SWEEP, "over_temperature", "shaker_amplifier", ONCE), "stopped"),
        (Cell(SWEEP, "stuck_reading", "strain_indicator", STAYS), "stopped"),
        (Cell(SWEEP, "zero_drift", "strain_indicator", STAYS), "stopped"),
        (Cell(CALIBRATE, "not_a_number", "strain_indicator", STAYS), "stopped"),
        (Cell("test modulus", "zero_drift", "strain_indicator", STAYS), "stopped"),
    ],
    "real_bench": [
        (Cell(SWEEP, "silence", "load_cell", ONCE), "right"),
        (Cell(SWEEP, "bit_error", "line", ONCE), "right"),
        (Cell(SWEEP, "power_cycle", "load_cell", ONCE), "right"),
        (Cell(SWEEP, "stuck_reading", "load_cell", STAYS), "stopped"),
        (Cell(SWEEP, "zero_drift", "load_cell", STAYS), "stopped"),
        (Cell(SWEEP, "not_a_number", "load_cell", ONCE), "right"),
        (Cell(SWEEP, "no_heartbeat", "films", STAYS), "right"),
        (Cell(SWEEP, "saturated_film", "films", STAYS), "marked"),
        (Cell(SWEEP, "node_reboot", "exciter", ONCE), "stopped"),
    ],
    "flintec-dad-141": [
        (Cell(SWEEP, "late_answer", "cell", ONCE), "right"),
        (Cell(SWEEP, "leading_glitch", "line", STAYS), "right"),
        (Cell(SWEEP, "front_panel", "cell", ONCE, (("setting", "filter_level"), ("value", 5.0))), "right"),
    ],
    "canopennode-io": [
        (Cell(SWEEP, "lost_frame", "io", ONCE), "right"),
        (Cell(SWEEP, "duplicated_frame", "io", ONCE), "right"),
        (Cell(SWEEP, "node_reboot", "io", ONCE), "right"),
    ],
    "baumer-dsrt": [
        (Cell(SWEEP, "delayed_frame", "film_2", ONCE), "right"),
        (Cell(SWEEP, "node_reboot", "film_2", ONCE), "right"),
        (Cell(SWEEP, "node_reboot", "clock", ONCE), "right"),
    ],
    "nanotec-c5-e": [(Cell(SWEEP, "bus_off", "can", STAYS), "stopped")],
    "leadshine-cs2rs": [(Cell(SWEEP, "power_cycle", "stage", ONCE), "right or stopped")],
    "oriental-motor-blvd-krd": [(Cell(SWEEP, "power_cycle", "stage", ONCE), "right")],  # its encoder is absolute
}


NOTICED = ("", "canopennode-io", "baumer-dsrt")  # benches on which each of these faults costs an incident


def chosen() -> list[Cell]:
    """One cell of every third kind, each procedure in its turn; of those waited for in vain, one that passes."""
    kinds = [kind for kind in FAULTS if kind not in {cell.kind for cell, _ in KNOWN[""]}][::3]
    found = []
    for number, (kind, procedure) in enumerate(zip(kinds, itertools.cycle(PROCEDURES), strict=False)):
        short = issubclass(fault_class(kind), (TcpFault, RtuFault, CanFault))
        of_kind = [cell for cell in cells() if (cell.kind, cell.procedure) == (kind, procedure)]
        able = [cell for cell in of_kind if not (short and cell.lasts == STAYS)]
        found.append(able[number % len(able)])
    return found


def test_the_matrix_has_every_fault_on_everything_that_can_have_it_in_every_procedure() -> None:
    whole = list(cells())
    assert (len({cell.name for cell in whole}), {cell.kind for cell in whole}) == (len(whole), set(FAULTS))
    assert {cell.procedure for cell in whole} == {cell.procedure for cell in chosen()} == set(PROCEDURES)
    assert {cell.on for cell in whole} == {
        "signal_generator", "shaker_amplifier", "strain_indicator", "positioner", "sample_changer", "line", "can",
        "sensor_node_1",
    }  # fmt: skip


def test_the_matrix_of_real_bench_strikes_each_of_its_devices_and_links() -> None:
    whole = list(cells((SWEEP,), real_bench))
    assert {cell.on for cell in whole} == {"exciter", "load_cell", "stage", "films", "line", "can", "sample_changer"}
    ours = {kind for kind in FAULTS if {*fault_class(kind).targets} <= {"strain_indicator", "sensor_node"}}
    assert {cell.kind for cell in whole} == {*FAULTS} - ours


@pytest.mark.parametrize("cell", chosen(), ids=lambda cell: cell.name)
def test_a_fault_ends_in_a_right_result_a_mark_or_a_clear_stop_with_outputs_at_zero(
    cell: Cell, nothing_left_behind: None
) -> None:
    outcome = play(cell)
    assert outcome.verdict in ("right", "marked", "stopped"), outcome.said


@pytest.mark.parametrize(
    ("devices", "cell", "verdicts"),
    [
        pytest.param(devices, *each, id=f"{devices} {each[0].name}")
        for devices, known in KNOWN.items()
        for each in known
    ],
)
def test_what_can_be_made_good_is_and_what_cannot_is_marked_or_stops(
    devices: str, cell: Cell, verdicts: str, nothing_left_behind: None
) -> None:
    outcome = play(cell, BENCHES[devices])
    assert outcome.verdict in verdicts.split(" or "), outcome.said
    assert outcome.incidents or devices not in NOTICED or outcome.verdict != "right"
