"""Load sweeps with positioners of makers in the place of ours, through faults of their links."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import palpate
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.guests import guests
from palpate.simulators.scenes.scene import Scene
from tests.fault_matrix import ONCE, STAYS, Cell, play
from tests.fault_procedures import scene as without_scatter

KRD, KRD_CAN, C5, CS2RS = "oriental-motor-blvd-krd", "oriental-motor-blvd-krd-can", "nanotec-c5-e", "leadshine-cs2rs"


def with_stage(kind: str) -> Callable[[str], Scene]:
    """The scenes of the matrix of faults, in which a maker's positioner stands in for ours."""
    table = {"kind": kind, "role": "positioner", "metres_per_step": 1e-6, "travel": "25 mm"}
    return lambda procedure: replace(without_scatter(procedure), devices=guests({"stage": table}, "scene"))


def test_the_line_of_a_bench_on_which_one_device_is_replaced_can_have_another_address() -> None:
    with SimulatedBench(with_stage(KRD)("sweep loads")) as sim:
        links = sim.description.moved({"line": {"port": "/dev/other"}}).links
    assert getattr(links["line"], "port", "") == "/dev/other"


@pytest.mark.slow
@pytest.mark.parametrize("kind", [KRD, C5])
def test_a_bus_log_of_a_sweep_with_it_can_be_replayed(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path))
    scene, log = tmp_path / "scene.toml", tmp_path / "log.pcapng"
    scene.write_text(with_stage(kind)("sweep loads").to_toml(), encoding="utf-8")
    with palpate.open_bench(scene=str(scene), log=log) as bench:
        done = palpate.run(palpate.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.5), bench, out=tmp_path / "run")
    assert palpate.replay(log, tmp_path / "again").run.digest() == done.run.digest()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "fault", "on", "lasts", "verdicts"),
    [
        (KRD, "power_cycle", "stage", ONCE, {"right"}),  # its encoder is absolute
        (CS2RS, "power_cycle", "stage", ONCE, {"right", "stopped"}),
        (C5, "bus_off", "can", STAYS, {"stopped"}),
    ],
)
def test_a_fault_of_its_link_ends_in_a_right_result_or_a_clear_stop_with_outputs_at_zero(
    kind: str, fault: str, on: str, lasts: str, verdicts: set[str], nothing_left_behind: None
) -> None:
    outcome = play(Cell("sweep loads", fault, on, lasts), with_stage(kind))
    assert outcome.verdict in verdicts, outcome
