"""No write or sync that fails, tears or is dropped costs an acknowledged point of which no check says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.procedures.records import chain
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from tests.benchmarks.records import cuts, failing
from tests.procedures.conftest import HEADER


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setattr(chain, "AHEAD", 2000)  # a million zeros take their time in each case
    with Recorder.create(tmp_path / "run", HEADER) as record:
        for n in (1, 2):
            record.point({"load_N": 0.5 * n}, {"rigid": (250.0, np.sin(0.1 * n * np.arange(300)))}, n)
        record.finish("complete", {"points": 2})
    return Run.open(tmp_path / "run")


def test_an_operation_that_fails_costs_no_acknowledged_point(run: Run, tmp_path: Path) -> None:
    assert set(failing(run, tmp_path)) == {"kept"}


def test_a_power_cut_costs_no_acknowledged_point(run: Run, tmp_path: Path) -> None:
    assert set(cuts(run, tmp_path, 1, lying=False)) == {"kept"}


@pytest.mark.slow
def test_what_a_disk_that_drops_a_sync_loses_is_told(run: Run, tmp_path: Path) -> None:
    found = cuts(run, tmp_path, 0, lying=True)
    assert found["lost and told"]
    assert not found["silent"]
