"""What a sweep looks at before it drives, and what it leaves alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.drivers.bench import Bench
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.errors import BenchError
from palpate.procedures.records.run import Run
from palpate.procedures.steps.probe import check_zero
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import Palpate

SMALL = ("sweep", "loads", "--samples", "2", "--loads", "2 N")


def test_a_tare_that_somebody_left_is_cleared(bench: Bench) -> None:
    indicator = bench.device("strain_indicator")
    indicator.track(0.1)
    for weight in (0.2, 0.0):
        bench.operator.place_weight(weight)
        bench.clock.wait(1.0)
        if weight:
            indicator.command("tare")
    assert indicator.read().reading_mV < -15
    check_zero(bench, THESIS_LOAD_CELL)
    assert indicator.read().reading_mV == pytest.approx(1.8, abs=1.5)


def test_a_weight_left_on_the_cell_stops_the_sweep_before_it_drives(bench: Bench, sim: SimulatedBench) -> None:
    bench.operator.place_weight(0.05)
    with pytest.raises(BenchError, match=r"without load.*thesis Table 5\.1.*take the load off"):
        check_zero(bench, THESIS_LOAD_CELL)
    assert not sim.amplifier.settings["enable"]


@pytest.mark.parametrize(
    ("zero", "told"),
    [
        ({}, r"says 20 ± 3\.1 mV"),
        ({"zero_u": 0.05, "resolution_mV": 0.01, "scatter_mV": 0.3}, r"says 20 ± 0\.48 mV"),
    ],
)
def test_a_calibration_of_another_zero_is_not_used_where_it_differs_by_more_than_readings_scatter(
    bench: Bench, zero: dict[str, float], told: str
) -> None:
    """Else one run in five on an indicator with steps of 0.01 mV stops: its mean of four readings scatters by more."""
    with pytest.raises(BenchError, match=told):
        check_zero(bench, THESIS_LOAD_CELL.model_copy(update={"zero_mV": 20.0, **zero}))


@pytest.mark.slow
def test_the_scene_kept_with_a_run_gives_that_run_again(palpate: Palpate) -> None:
    first = palpate(*SMALL, "--seed", "7", "--model", "column", "--out", "first", "--json").object
    again = palpate(*SMALL, "--scene", "first/scene.toml", "--out", "again", "--json").object
    assert (again["seed"], again["model"]) == (7, "column")
    assert again["points"] == first["points"]
    assert Run.open(Path("again")).digest() == Run.open(Path("first")).digest()


def test_a_real_bench_does_not_sweep_on_the_thesis_calibration(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Bench, "simulated", False)
    spoken = palpate(*SMALL)
    assert spoken.status == 2
    assert "has no calibration; run palpate calibrate load-cell" in spoken.complaint
