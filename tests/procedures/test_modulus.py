"""A sample is compressed on the rigid support, and its modulus is that of the scene."""

from __future__ import annotations

from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest

from palpate import ModulusTest, RangeError, Run, get_design, get_sample
from palpate.extend import Bench, Lab, LoadCellCalibration, Recorder, SafetyError, Target
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.errors import UnreachableError
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.uncertainty import budget
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab import operator
from palpate.procedures.lab.operator import ConsoleOperator
from palpate.procedures.measurements import modulus
from palpate.procedures.measurements.modulus import ModulusResult
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import HEADER, IDEAL_CALIBRATION, IDEAL_SCENE, scene_of

THREE = ModulusTest("1", strain=0.3, steps=3)


def compressed(
    bench: Bench, folder: Path, settings: ModulusTest = THREE, calibration: LoadCellCalibration = THESIS_LOAD_CELL
) -> ModulusResult:
    with Recorder.create(folder, HEADER) as record:
        result = conduct(settings, Lab(bench, get_design("single"), calibration), record)
        record.finish("complete", result.summary())
    return result


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer displays and trials than anybody would take."""
    monkeypatch.setattr(modulus, "DISPLAYS", 4)
    monkeypatch.setattr(budget, "TRIALS", 2000)


def test_the_modulus_is_that_of_the_sample_and_every_step_is_kept(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(modulus, "DISPLAYS", 8)  # with 4, one seed of eight gives an uncertainty above a tenth
    result = compressed(bench, tmp_path / "run")
    c, sample = result.compression, get_sample("1")
    for found, true in (
        (c.tangent, sample.modulus), (c.secant, sample.modulus), (c.unloading, sample.modulus),
        (c.thickness, sample.thickness),
    ):  # fmt: skip
        assert abs(found.value - true) < 3 * found.u
        assert found.u < 0.1 * true
    run = Run.open(tmp_path / "run")
    assert (run.summary, [p["series"] for p in run.points()]) == (
        result.summary(),
        [*3 * ["bare"], *3 * ["loading"], *3 * ["unloading"]],
    )
    assert [p.strain for p in c.points if p.direction == "loading"] == pytest.approx([0.1, 0.2, 0.3], abs=0.04)


def test_a_creeping_sample_reads_stiffer_and_does_not_give_all_its_work_back(tmp_path: Path) -> None:
    creeping = '\n[effects.viscoelastic]\nmaterial = "soft_tissue"\n'
    with (
        SimulatedBench(scene_of(IDEAL_SCENE + creeping, tmp_path)) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
    ):
        c = compressed(bench, tmp_path / "run", calibration=IDEAL_CALIBRATION).compression
    assert c.tangent.value > 1.1 * get_sample("1").modulus
    assert c.energy_loss.value > 0.02


def test_a_travel_that_ends_before_is_refused_before_the_sample_is_pressed(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SAMPLES, "1", replace(get_sample("1"), modulus=160e3))
    bench.device("positioner").set_limits(0.0, 18.5e-3)
    with pytest.raises(UnreachableError, match=r"needs the positioner at 20\.\d+ mm, which ends at 18.5 mm; ask for a"):
        compressed(bench, tmp_path / "run", ModulusTest("1", strain=0.6, steps=3, extrapolate=True))
    assert {p["series"] for p in Run.open(tmp_path / "run").points()} == {"bare"}


def test_more_force_than_the_limit_sends_the_probe_home(
    sim: SimulatedBench, bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = sim.indicator.read

    def stiff(name: str) -> float:
        return read(name) + 100 * (sim.rig.position > 12.5e-3 and name in ("reading", "reading_float"))

    monkeypatch.setattr(modulus, "preload", lambda *_: 1.0 if bench.device("positioner").move(12e-3) is None else 0.0)
    monkeypatch.setattr(modulus.np, "linspace", lambda *_: modulus.np.array([12.2e-3, 12.4e-3, 12.6e-3]))
    monkeypatch.setattr(sim.indicator, "read", stiff)
    with pytest.raises(SafetyError, match=r"more than the bench's force limit of 10 N; the probe has moved home"):
        compressed(bench, tmp_path / "run")
    assert sim.rig.position == 0


def test_a_pad_beyond_the_travel_or_a_force_beyond_the_limit_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(
        RangeError, match=r"takes about 3.38 N, above the bench's force limit of 2 N; strains up to 0.18"
    ):
        THREE.check(Target(get_design("single"), 2.0, 1))
    monkeypatch.setitem(SAMPLES, "1", replace(get_sample("1"), thickness=30e-3))
    with pytest.raises(RangeError, match="is 30 mm thick, beyond the positioner's travel of 25 mm; test a thinner"):
        THREE.check(Target(get_design("single"), 10.0, 1, travel=25e-3))
    THREE.check(Target(get_design("single"), 10.0, 1))  # a positioner that does not say how far it goes


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        (replace(THREE, strain=0.02), UnreachableError, "gives about 225 mN, below 4 steps of the load indicator"),
        (
            ModulusTest("2", strain=0.2, steps=3),
            UnreachableError,
            "of the loads up to about 483 mN, in 3 steps, 2 would be above 194 mN, which surely is contact, and 3 are",
        ),
        (replace(THREE, strain=0.6), RangeError, r"lies outside the 1.373 to 5 N that the load cell is calibrated for"),
    ],
)
def test_a_load_that_cannot_be_read_is_refused(
    bench: Bench, tmp_path: Path, settings: ModulusTest, error: type[Exception], message: str
) -> None:
    narrow = THESIS_LOAD_CELL.model_copy(update={"greatest_N": 5.0})
    with pytest.raises(error, match=message):
        compressed(bench, tmp_path / "run", settings, narrow)
    assert bench.device("positioner").position() == 0


def test_loads_that_may_be_no_contact_count_neither_in_a_run_nor_in_what_is_expected_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(modulus, "DISPLAYS", 10)

    def expected(steps: int, strain: float = 0.3) -> dict[str, float]:
        plan = ModulusTest("4", strain, steps).plan(Target(get_design("single"), 10.0, 1))
        return {row["name"]: row["u"] for row in plan.predicted.details["predicted_results"]}

    runs = {"tangent modulus": 0.0283, "unloading modulus": 0.0346, "thickness": 0.00877}  # rms of 24 drawn runs
    for name, u in runs.items():
        assert expected(10)[name] == pytest.approx(u, rel=0.05)  # by all ten loads it is 0.83 to 0.89 of it
    assert expected(3, 0.05) == {}


def test_a_person_is_asked_for_the_support_bare_and_with_the_sample(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", StringIO("bare\n1\n"))
    monkeypatch.setattr(operator, "at_terminal", lambda: True)
    person = ConsoleOperator()
    person.lay_on_support(None)
    person.lay_on_support(get_sample("1"))
    place = "Put the rigid support in the sensor's place"
    assert capsys.readouterr().err.splitlines() == [
        f"{place}, bare; then type bare and press Enter",
        f"{place}, with sample 1 (white silicone rubber, 3 mm) on it; then type 1 and press Enter",
    ]
