"""What `import palpate` gives stays as it is: names, signatures, and a script outside that uses them.

Types are held against the installed wheel, by `.ci/wheel`.
"""

from __future__ import annotations

import inspect
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

import palpate
from palpate import extend
from palpate.extend import Lab, Measurement, Plan, Recorder, Step
from palpate.testing import steps
from tests.examples.relaxation import Holding, Reading, Relaxation
from tests.procedures.conftest import interrupt_at

OUTSIDE = Path(__file__).parents[1] / "examples" / "relaxation.py"
SOFT = """
name = "soft tissue"
purpose = "A sample that relaxes under a preload."
design = "single"
model = "experiment"
[effects.viscoelastic]
material = "soft_tissue"
[effects.load_cell]
sensitivity = "10.306 mV/N"
zero = "1.81 mV"
noise = "0.3 mV"
decimals = 2
"""
SIGNATURES = {
    "Characterisation": "sample loads dwell frequency drift_time tolerance time",
    "Column": "doc unit head cell scale u after each",
    "DynamicLoadWork": "lab record loads frequency samples extrapolate",
    "Event": "kind bench_ns data",
    "FilmCalibration": (
        "accepted device scene simulated source created expires design films covariance crosstalk crosstalk_u "
        "frequencies_Hz gain least_N greatest_N load_cell load_cell_degrees_of_freedom"
    ),
    "FilmSeries": "loads frequencies dwell valid_days extrapolate tolerance",
    "Finished": "procedure result session outcome unstored",
    "FrequencySweep": "frequencies sample load dwell extrapolate",
    "Lab": "bench design calibration films run started references mountings",
    "Load": "force sensed interface at",
    "LoadCellCalibration": (
        "accepted device scene simulated source created expires sensitivity_mV_per_N sensitivity_u zero_mV zero_u "
        "covariance degrees_of_freedom least_N greatest_N linearity reversibility reversibility_of_reading "
        "repeatability reproducibility interpolation zero_return creep resolution_mV scatter_mV "
        "lower_limit_factor_N astm_e74 iso_376 gage_factor curvature"
    ),
    "LoadCellSeries": "loads runs positions degree creep valid_days iso_class tolerance loads_u",
    "LoadSweep": "samples loads dwell frequency tolerance extrapolate",
    "Measurement": "point waveforms error beside",
    "ModelCalibration": (
        "accepted device scene simulated source created expires design model parameters thickness_m references "
        "constant constant_u films_u films_degrees_of_freedom pickup_u spread spread_degrees_of_freedom weight "
        "prior film_calibration"
    ),
    "ModulusTest": "sample strain steps extrapolate",
    "OpenBench": "bench chosen today started wall_start log runs history",
    "ObjectModulus": (
        "object tolerance time relative_to_model model load frequency mountings mounting_scatter mounting_freedom"
    ),
    "Plan": "procedure steps forecast basis",
    "Predicted": "seconds u details lines",
    "PositionSweep": "positions sample load dwell frequency tolerance time extrapolate",
    "Procedure": "",
    "Recorder": "folder header listener",
    "Reference": "name modulus u source digest sample simulated scene",
    "ReferenceSeries": "references loads dwell frequency model parameters thickness valid_days",
    "Report": "show draw",
    "RequiredLoads": "values extrapolate",
    "Response": "model force_rigid force_total force_ratio error_estimate tooth_forces films stiffness why",
    "Run": "folder procedure simulated started status header summary",
    "Setting": "unit help read option metavar default example repeated determines",
    "SimpleResult": "points values budgets",
    "SoftnessTest": "objects loads dwell frequency model risk sets",
    "StaticLoadWork": "lab sample force",
    "Step": "dwell_s seconds_expected ratio_u_expected what group",
    "Target": (
        "design force_limit nodes model channels frequency_step travel drivable calibrated references load_cell scene "
        "mountings mounts"
    ),
    "TemperatureSweep": "temperatures sample load dwell frequency soak extrapolate",
    "Work": "args kwargs",
    "as_dataset": "run",
    "gathered": "kind sources own",
    "get_design": "name",
    "get_sample": "name",
    "judge": "of limits",
    "open_bench": "scene bench seed model log operator assume_mounted about",
    "plan": "procedure bench",
    "read": "folder",
    "read_calibration": "path kind edited",
    "read_reference": "text",
    "replay": "log out kind listeners",
    "response": "design load model tolerance",
    "resume": "run kind bench accept_change listeners pause",
    "run": "procedure bench out listeners pause",
    "runs": "folder where",
    "unknown_object": "design thickness modulus name",
    "watch": "run",
}
ERRORS = "BenchError ConfigError EstimateError PalpateError RangeError RecordError UnknownName UsageError"
MEMBERS = {  # what a script or a class of its own uses
    "DynamicLoadWork": "again end held hold load_set measured measurement press set",
    "Finished": "conclude folder outcome plot procedure replayed result run session unstored",
    "Lab": "bench calibration design film_hash films mountings origin references run same_films scene started target",
    "OpenBench": "bench chosen history lab log runs scene started target today wall_start",
    "Plan": "basis forecast predicted procedure seconds steps summary",
    "Procedure": (
        "automated_by begin calibrates calibrating check check_result constants course dwells evaluate manual_work "
        "model_question name on pausable plan point recorded report required_loads "
        "resumable_on_real_bench save_calibration"
    ),
    "Recorder": "begin_dwell close create event finish finished measured point points tell",
    "Run": (
        "about digest events folder header open points procedure signal_digest simulated started status summary "
        "table waveform waveform_names waveforms"
    ),
    "StaticLoadWork": "arrange end load",
    "Target": (
        "calibrated channels design drivable force_limit frequency_step load_cell model mountings mounts nodes "
        "references scene travel"
    ),
    "Work": "arrange end take",
}


def members(public: type) -> set[str]:
    """Names of a class and of those of palpate that it inherits from, without those that begin with an underscore."""
    ours = [each for each in public.__mro__ if each.__module__.startswith("palpate.")]
    return {name for each in ours for name in (*vars(each), *vars(each).get("__annotations__", ())) if name[0] != "_"}


def public(name: str) -> Any:
    """What a name in `palpate` or in `palpate.extend` stands for."""
    return getattr(palpate if name in palpate.__all__ else extend, name)


def test_the_public_names_and_their_parameters_stay() -> None:
    for module in (palpate, extend):
        assert {name for name in module.__all__ if getattr(module, name) is None} == set()
    assert set(palpate.__all__) <= {*SIGNATURES, *ERRORS.split()}
    assert set(SIGNATURES) <= {*palpate.__all__, *extend.__all__}
    assert not set(palpate.__all__) & set(extend.__all__)
    found = {name: " ".join(inspect.signature(public(name)).parameters) for name in SIGNATURES}
    assert (found, {name: " ".join(sorted(members(public(name)))) for name in MEMBERS}) == (SIGNATURES, MEMBERS)
    with pytest.raises(AttributeError, match="has no attribute 'open_bank'"):
        palpate.open_bank  # noqa: B018


def test_the_name_alone_imports_nothing() -> None:
    code = "import sys, palpate; assert palpate.__all__; assert not {'numpy', 'click', 'pydantic'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_simulated_sweep_is_a_table_in_five_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A list is as good as a tuple."""
    monkeypatch.chdir(tmp_path)
    with palpate.open_bench(scene="thesis_single", seed=3) as bench:
        sweep = palpate.LoadSweep(samples=["1"], loads=[2.0, 3.0], dwell=0.2)  # type: ignore[arg-type]
        assert palpate.plan(sweep, bench).seconds > 0
        done = palpate.run(sweep, bench, out="first")
    assert "OpenBench(" not in repr(done)
    table = done.run.table()
    assert (list(table["load_N"]), table["simulated"].all()) == ([2.0, 3.0], True)
    assert (done.result.softness_order, done.plot()) == (["1"], done.folder / "plot.png")
    assert palpate.as_dataset(done.run).sizes["point"] == 2


def test_it_takes_twenty_lines() -> None:
    body = OUTSIDE.read_text(encoding="utf-8").partition("@dataclass")[2]
    assert len([line for line in body.splitlines() if line.strip()]) <= 20


def test_a_bench_takes_run_after_run_no_two_at_once_and_none_once_one_has_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second one at once would exchange the sample under the other one."""
    monkeypatch.chdir(tmp_path)
    held, seen = Relaxation(readings=2), []

    def another(done: int, _total: int, _what: str) -> None:
        if done == 1:
            with pytest.raises(palpate.UsageError, match=r"no other run can begin on this bench before") as refused:
                palpate.run(Relaxation(sample="1", readings=1), bench, out="other")
            seen.append(refused)

    with palpate.open_bench(scene="ideal") as bench:
        first = palpate.run(held, bench, out="first", listeners=[steps(another)])
        second = palpate.run(held, bench, out="second")
        assert ([len(each.run.points()) for each in (first, second)], len(seen)) == ([2, 2], 1)
        with pytest.raises(palpate.UsageError, match="already holds a run"):
            palpate.run(held, bench, out="first")
        with pytest.raises(KeyboardInterrupt):
            palpate.run(held, bench, out="third", listeners=[steps(interrupt_at(1))])
        assert not bench.bench.driving
        closed = "it is closed, as its block ended or a run failed; open the bench anew"
        with pytest.raises(palpate.UsageError, match=closed):
            palpate.run(held, bench, out="fourth")
    assert palpate.read("third").status == "stopped"


def test_after_a_pause_only_outputs_that_were_on_before_are_on(tmp_path: Path) -> None:
    class Looking(Holding):
        def arrange(self, _step: Step) -> None:
            pass

        def take(self, step: Step) -> Measurement[Reading]:
            assert not self.bench.driving
            return super().take(step)

    class Resting(Relaxation):
        name, pausable = "resting", True

        def begin(self, plan: Plan, lab: Lab, record: Recorder) -> Looking:
            return Looking(lab, self.sample, self.force)

    pause = Mock(asked=Mock(side_effect=[True]))  # before the first point
    with palpate.open_bench(scene="ideal") as bench:
        done = palpate.run(Resting(readings=1), bench, out=tmp_path / "run", pause=pause)
    assert [event["kind"] for event in done.run.events()] == ["paused", "resumed"]


@pytest.mark.parametrize(
    ("procedure", "wrong"),
    [
        (palpate.LoadSweep, "is no procedure; give an object of one"),
        (palpate.LoadSweep(dwell="1 s"), "dwell = '1 s' is no number; give one without quotes; its type is float"),  # type: ignore[arg-type]
        (palpate.LoadSweep(samples="12"), "samples = '12' is no list"),  # type: ignore[arg-type]
        (palpate.LoadSweep(loads=()), r"loads = \(\): nothing is given; give at least one"),
        (palpate.FrequencySweep(()), r"frequencies = \(\): nothing is given"),
    ],
)
def test_a_setting_of_a_wrong_type_is_refused_before_anything_is_sent(
    procedure: palpate.LoadSweep, wrong: str, tmp_path: Path
) -> None:
    with palpate.open_bench(scene="ideal") as bench, pytest.raises(palpate.UsageError, match=wrong):
        palpate.run(procedure, bench, out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_checkout_without_symbolic_links_says_so(tmp_path: Path) -> None:
    (tmp_path / "palpate").mkdir()
    shutil.copy(palpate.__file__, tmp_path / "palpate")
    (tmp_path / "palpate" / "procedures").write_text("../procedures")  # as Windows, or a zip, gives a link
    done = subprocess.run([sys.executable, "-c", "import palpate"], cwd=tmp_path, capture_output=True, text=True)
    assert "this checkout was made without links" in done.stderr


def test_a_procedure_of_ones_own_that_was_interrupted_ends_as_one_that_was_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("soft.toml").write_text(SOFT, encoding="utf-8")

    with palpate.open_bench(scene="soft.toml", log="log.pcapng") as bench:
        whole = palpate.run(Relaxation(), bench, out="whole")
    assert 0.02 < float(str(whole.result.values["relaxed"])) < 0.9
    assert whole.result.points[-1].load_N < whole.result.points[0].load_N < 2.2
    with pytest.raises(KeyboardInterrupt), palpate.open_bench(scene="soft.toml") as bench:
        palpate.run(Relaxation(), bench, out="cut", listeners=[steps(interrupt_at(2))])
    for call, why in (
        (lambda: palpate.replay("log.pcapng"), r"give the class to palpate\.replay in a script"),
        (
            lambda: palpate.replay("log.pcapng", "x", palpate.LoadSweep),
            "'relaxation', not 'sweep-loads'; name its class",
        ),
        (
            lambda: palpate.resume("cut"),
            r"cut: 'relaxation' of relaxation.py cannot be resumed without its class: install its package, or give the "
            "class to palpate.resume in a script; known: sweep-loads",
        ),
    ):
        with pytest.raises(palpate.UsageError, match=why):
            call()
    again, replayed = palpate.resume("cut", Relaxation), palpate.replay("log.pcapng", "again", Relaxation)
    assert {each.run.digest() for each in (again, replayed)} == {whole.run.digest()}
    assert (again.run.header["procedure_from"], again.result.summary()) == ("relaxation.py", whole.result.summary())


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_wheel_that_is_built_from_a_checkout_without_symbolic_links_is_whole(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    if shutil.which("uv") is None:
        pytest.skip("uv, which builds wheels, is not installed")
    for name in ("palpate", "drivers", "instrument", "simulators", "procedures"):
        shutil.copytree(root / name, tmp_path / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(root / name, tmp_path)
    for link in filter(Path.is_symlink, (tmp_path / "palpate").iterdir()):
        text = str(link.readlink())
        link.unlink()
        link.write_text(text, encoding="utf-8")
    done = subprocess.run(["uv", "build", "-q", "--wheel", "."], cwd=tmp_path, capture_output=True, text=True)
    if "hatchling" in done.stderr:
        pytest.skip(f"hatchling, which builds wheels, cannot be had: {done.stderr.splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = {*archive.namelist()}
    assert {"palpate/procedures/commands/root.py", "palpate/simulators/scenes/thesis_single.toml"} <= names
    assert {name for name in names if not name.startswith(("palpate/", "palpate-"))} == set()
