"""Load sweeps with positioners of makers in the place of ours, through faults of their links."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from palpate.simulators.guests import guests
from palpate.simulators.scenes.scene import Scene
from tests.fault_matrix import ONCE, STAYS, Cell, play
from tests.fault_procedures import scene as without_scatter

KRD, KRD_CAN, C5, CS2RS = "oriental-motor-blvd-krd", "oriental-motor-blvd-krd-can", "nanotec-c5-e", "leadshine-cs2rs"


def with_stage(kind: str) -> Callable[[str], Scene]:
    """The scenes of the matrix of faults, in which a maker's positioner stands in for ours."""
    table = {"kind": kind, "role": "positioner", "metres_per_step": 1e-6, "travel": "25 mm"}
    return lambda procedure: replace(without_scatter(procedure), devices=guests({"stage": table}, "scene"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "fault", "on", "lasts", "verdicts"),
    [
        (KRD, "silence", "stage", ONCE, {"right"}),
        (KRD, "bit_error", "stage", ONCE, {"right"}),
        (KRD, "power_cycle", "stage", ONCE, {"right"}),  # its encoder is absolute
        (KRD, "silence", "stage", STAYS, {"stopped"}),
        (CS2RS, "silence", "stage", ONCE, {"right"}),
        (CS2RS, "power_cycle", "stage", ONCE, {"right", "stopped"}),
        (KRD_CAN, "node_reboot", "stage", ONCE, {"right"}),
        (C5, "node_reboot", "stage", ONCE, {"right", "stopped"}),
        (C5, "bus_off", "can", STAYS, {"stopped"}),
    ],
)
def test_a_fault_of_its_link_ends_in_a_right_result_or_a_clear_stop_with_outputs_at_zero(
    kind: str, fault: str, on: str, lasts: str, verdicts: set[str], nothing_left_behind: None
) -> None:
    outcome = play(Cell("sweep loads", fault, on, lasts), with_stage(kind))
    assert outcome.verdict in verdicts, outcome
