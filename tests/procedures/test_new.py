"""`palpate new` makes packages that pass their tests as they stand, by the pytest plugin that gives each a bench."""

from __future__ import annotations

import keyword
import subprocess
import sys
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy.fft  # noqa: F401  (it can be loaded once, and what a test with `pytester` imports is forgotten with it)
import pytest

import palpate
import palpate.procedures.testing.benches
import palpate.testing
from palpate import UsageError, get_design
from palpate.procedures.templates.new_files import new_bench, new_device, new_package
from palpate.simulators.bench import SimulatedBench
from tests.conftest import Install
from tests.procedures.conftest import Palpate

pytest_plugins = ["pytester"]
pytestmark = pytest.mark.usefixtures("nothing_left_behind")
NEW: dict[str, Callable[[str, Path], list[Path]]] = {
    "device": lambda name, folder: new_device(name, "modbus-tcp", "sensor", folder),
    "design": partial(new_package, "design"),
    "effect": partial(new_package, "effect"),
    "procedure": partial(new_package, "procedure"),
    "bench": lambda name, folder: new_bench(name, (), folder),
}


def conform(pytester: pytest.Pytester, test: Path, *choice: str) -> pytest.RunResult:
    """One file of tests, in this process, with the fixtures of palpate's plugin."""
    import pint  # noqa: F401  (what an inner session imports is forgotten with it, and dask comes with pint)

    alone = pytester.makefile(".ini", pytest="")  # else a project's in a folder above, such as one that $TMPDIR lies in
    options = ("--disable-plugin-autoload", "--import-mode=importlib", "-p", "tests.conftest", "-c", str(alone))
    return pytester.runpytest_inprocess(*options, *choice, str(test))


@pytest.fixture
def installed(install: Install, monkeypatch: pytest.MonkeyPatch) -> Callable[[list[Path]], Path]:
    """Puts a written package where Python finds it, as `pip install -e` does; gives its test."""

    def put(files: list[Path]) -> Path:
        project = tomllib.loads(files[0].read_text(encoding="utf-8"))["project"]
        for group, entries in project["entry-points"].items():
            install(project["name"].replace("-", "_"), group, entries)
        monkeypatch.syspath_prepend(str(files[0].parent))
        return files[-1]

    return put


Put = Callable[[list[Path]], Path]

# --- packages ------------------------------------------------------------------------------------------


@pytest.mark.slow  # time-outs
@pytest.mark.parametrize(
    ("bus", "kind"),  # CI installs a sensor on Modbus RTU and a CANopen actuator, and runs their tests
    [("modbus-tcp", "registers"), ("canopen", "sensor")],
)
def test_a_device_passes_as_it_stands(
    bus: str, kind: str, tmp_path: Path, pytester: pytest.Pytester, installed: Put
) -> None:
    name = f"gauge_{bus[-3:]}_{kind[:5]}"  # of its own: what a package has imported stays
    found = conform(pytester, installed(new_device(name, bus, kind, tmp_path))).parseoutcomes()
    assert found.keys() <= {"passed", "skipped"}
    assert found["passed"] >= 19


@pytest.mark.parametrize("bus", ["modbus-tcp", "canopen"])
@pytest.mark.parametrize(
    "kind", ["sensor", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("actuator", "registers"))]
)
def test_a_wrong_scale_does_not_pass(
    kind: str, bus: str, tmp_path: Path, pytester: pytest.Pytester, installed: Put
) -> None:
    files = new_device(f"wrong_{bus[:3]}_{kind[:5]}", bus, kind, tmp_path)
    text = files[1].read_text(encoding="utf-8")
    assert '"V", 1e-6' in text
    files[1].write_text(text.replace('"V", 1e-6', '"V", 1e-5'), encoding="utf-8")
    conform(pytester, installed(files), "-k", "golden").stdout.fnmatch_lines(["FAILED *_travels_as_its_golden_frame*"])


@pytest.mark.slow
def test_an_effect_passes_as_it_stands_and_a_wrong_one_does_not(
    tmp_path: Path, pytester: pytest.Pytester, installed: Put
) -> None:
    pyproject, effect, test = new_package("effect", "cable_sag", tmp_path)
    installed([pyproject, effect, test])
    quick = ("-k", "loss or zero or name or gains")
    assert conform(pytester, test, *quick).parseoutcomes() == {"passed": 5, "deselected": 11}
    text = effect.read_text(encoding="utf-8")
    effect.write_text(text.replace("1 - self.loss", "1 - self.loss / 2"), encoding="utf-8")
    failed = conform(pytester, test, *quick)
    failed.stdout.fnmatch_lines(["FAILED *::test_it_takes_its_loss_from_the_films_under_the_teeth_alone*"])


def test_a_design_passes_as_it_stands_and_has_nothing_of_the_thesis(
    tmp_path: Path, pytester: pytest.Pytester, installed: Put
) -> None:
    test = installed(new_package("design", "grasper_7", tmp_path))
    assert conform(pytester, test).parseoutcomes() == {"passed": 1}
    design = get_design("grasper_7")
    assert (design.thesis_force_ratio, design.thesis_softness_order) == ({}, ())


@pytest.mark.parametrize("sweeps", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_bench_passes_as_it_stands_with_a_device_of_ones_own(
    sweeps: bool, tmp_path: Path, pytester: pytest.Pytester, installed: Put
) -> None:
    installed(new_device("own_gauge", "canopen", "sensor", tmp_path))
    *_, test = new_bench("corner", ("sample_changer", "own-gauge"), tmp_path)
    found = conform(pytester, test.parents[1], *(() if sweeps else ("-k", "not sweep"))).parseoutcomes()
    assert found == ({"passed": 3} if sweeps else {"passed": 2, "deselected": 1})
    assert "[device.own_gauge]" in (tmp_path / "corner" / "scene.toml").read_text(encoding="utf-8")


# --- the command ---------------------------------------------------------------------------------------


def test_the_command_writes_into_a_folder_of_its_own_and_over_nothing(palpate: Palpate) -> None:
    spoken = palpate("new", "device", "force_gauge", "--bus", "modbus-rtu", "--kind", "sensor", "--json")
    names = ("pyproject.toml", "force_gauge.py", "tests/force_gauge.toml", "tests/test_force_gauge.py")
    assert spoken.object == {"files": [f"force_gauge/{name}" for name in names]}
    assert '"FORCE-GAUGE"' in Path("force_gauge/force_gauge.py").read_text(encoding="utf-8")
    for kind in NEW:
        refused = palpate("new", kind, "force_gauge")
        assert (refused.status, refused.complaint) == (2, "force_gauge exists already; choose another name")
    said = palpate("new", "effect", "cable_sag").out
    assert said.startswith("cable_sag/pyproject.toml\n")
    assert "\n  pytest cable_sag\n\nThen put in your physics" in said


NO_NAMES = (
    "", "Oven", "2nd_oven", "oven__2", "oven_", "../oven", "a/b", "oven\n", "a" * 21, "öfen", "ⅷ",
    *filter(str.islower, keyword.kwlist),
)  # fmt: skip


@pytest.mark.parametrize("kind", NEW)
def test_what_is_no_name_is_refused_and_what_exists_left_alone_even_a_link_to_nothing(
    kind: str, tmp_path: Path
) -> None:
    for name in NO_NAMES:
        with pytest.raises(UsageError, match="is no name of a"):
            NEW[kind](name, tmp_path)
    (tmp_path / "oven_7").symlink_to("nowhere")
    with pytest.raises(UsageError, match=r"exists already; choose another name|begins with a letter"):
        NEW[kind]("oven_7", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["oven_7"]


@pytest.mark.parametrize(
    ("kind", "name", "why"),
    [
        ("device", "positioner", "palpate or an installed package has one of that name"),
        ("device", "acme_oven", "palpate or an installed package has one of that name"),
        ("effect", "white_noise", "palpate or an installed package has one of that name"),
        ("procedure", "sweep_loads", "palpate or an installed package has one of that name"),
        ("device", "json", "there is a Python module of that name already"),
        ("effect", "numpy", "there is a Python module of that name already"),
        ("procedure", "tests", "there is a Python module of that name already"),
        ("device", "path", "a class Path is used in its files already"),
        ("effect", "question", "a class Question is used in its files already"),
        ("procedure", "recorder", "a class Recorder is used in its files already"),
        ("effect", "sag_2", "a word of an effect's name begins with a letter; write 'sag2'"),
    ],
)
def test_a_name_that_means_something_else_is_refused(
    kind: str, name: str, why: str, tmp_path: Path, install: Install
) -> None:
    install("acme", "palpate.devices", {"acme-oven": "acme:KIND"})
    with pytest.raises(UsageError, match=f"^{name!r}: {why}"):
        NEW[kind](name, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_bench_with_a_device_that_cannot_be_is_refused(palpate: Palpate) -> None:
    for words, why in (
        (("--device", "oven"), "unknown kind of device 'oven'; valid: "),
        (("--device", "positioner"), "--device positioner: every bench has one; leave it out"),
        (2 * ("--device", "sample_changer"), "--device sample_changer: give a kind once; copy its section"),
    ):
        assert palpate("new", "bench", "corner", *words).complaint.startswith(why)
    assert not Path("corner").exists()


def test_no_two_names_give_one_identity(tmp_path: Path) -> None:
    """Whole names are coded, not their initials."""
    found = set()
    for name in ("force_gauge", "fine_gauge", "force_gauge2"):
        for bus in ("modbus-tcp", "canopen"):
            files = new_device(name, bus, "sensor", tmp_path / bus)
            lines = files[1].read_text(encoding="utf-8").splitlines()
            found |= {line for line in lines if line.startswith(("CONTRACT =", "VENDOR, PRODUCT"))}
    assert len(found) == 9  # on CANopen two lines each


# --- the pytest plugin: a bench for each test, and what went on when one fails ------------------------

ALONE = (
    "--disable-plugin-autoload",
    "-p",
    "palpate.procedures.testing",
)  # other plugins would be imported again each time


def run(pytester: pytest.Pytester, test: str, *options: str) -> pytest.RunResult:
    """One file of tests, in this process."""
    pytester.makepyfile(f"import pytest\n{test}")
    pytester.makefile(".ini", pytest="")  # else a project's in a folder above, such as one that $TMPDIR lies in
    return pytester.runpytest_inprocess(*ALONE, *options)


def test_each_test_gets_a_bench_of_its_own(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
@pytest.mark.parametrize("again", [False, True])
def test_fresh(again, bench, clock, operator, scene):
    assert scene.name == "thesis_single"
    assert bench.device("signal_generator").read() == (10.0, 0.0, 0.0)
    assert clock.now_ns() == 0
    bench.device("signal_generator").sine(20.0, 1.0)
    clock.wait(2.5)
    assert clock.now_ns() == 2_500_000_000
    assert operator is bench.operator
""",
    )
    result.assert_outcomes(passed=2)


def test_the_marker_says_scene_seed_and_faults(pytester: pytest.Pytester) -> None:
    (pytester.path / "mine.toml").write_text('name = "mine"\npurpose = "A file."\ndesign = "single"\n')
    result = run(
        pytester,
        """
@pytest.mark.scene("ideal", seed=7, faults=[{"kind": "over_current", "on": "shaker_amplifier", "at": "1 s"}])
def test_marked(bench, scene, clock):
    assert (scene.name, scene.seed) == ("ideal", 7)
    assert not bench.device("shaker_amplifier").read().faults_latched
    clock.wait(1.5)
    assert bench.device("shaker_amplifier").read().faults_latched == {"over_current"}

@pytest.mark.scene("mine.toml")
def test_file(scene):
    assert scene.name == "mine"
""",
    )
    result.assert_outcomes(passed=2)


def test_a_test_that_fails_tells_scene_seed_traffic_and_how_to_run_it_again(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
@pytest.mark.scene("ideal", seed=7)
@pytest.mark.parametrize("volts", [1.5])
def test_fails(volts, bench, clock):
    bench.device("signal_generator").sine(33.0, 0.5)
    clock.wait(3.0)
    bench.device("signal_generator").sine(20.0, volts)
    bench.device("sensor_node_1").acquire(0.05)
    bench.device("sensor_node_1").set_range(1, "500 mV")
    assert bench.device("shaker_amplifier").read().output_current > 1.0
""",
    )
    result.assert_outcomes(failed=1)
    told = "\n".join(result.outlines)
    assert "scene ideal, seed 7\n" in told
    assert "3.000000 s  signal generator: write frequency = 20 Hz, amplitude = 1.5 V, offset = 0 V" in told
    assert "frequency = 33 Hz" not in told  # longer ago than 2 s
    assert "3.050000 s  sensor node 1: 100 frames of process data, the last: sample_counter = 50" in told
    assert "sensor node 1: write range_1 = 500 mV" in told
    assert "shaker amplifier: read output_current = 0 A" in told
    assert "\nagain: pytest '" in told
    again = told.partition("again: pytest ")[2].splitlines()[0].strip("'")
    assert again == "test_a_test_that_fails_tells_scene_seed_traffic_and_how_to_run_it_again.py::test_fails[1.5]"


def test_a_bench_that_cannot_be_opened_is_told_as_well(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
@pytest.mark.scene("ideal", faults=[{"kind": "device_failure", "on": "shaker_amplifier", "transaction": 2}])
def test_busy(bench):
    pass
""",
    )
    result.assert_outcomes(errors=1)
    told = "\n".join(result.outlines)
    assert "\nfault {'kind': 'device_failure', 'on': 'shaker_amplifier', 'transaction': 2}\n" in told
    assert "shaker amplifier: read failed: answered exception 4, device failure" in told


def test_on_a_real_bench_what_needs_a_simulation_is_skipped(pytester: pytest.Pytester, sim: SimulatedBench) -> None:
    (pytester.path / "lab.toml").write_text(sim.description.patient().to_toml(), encoding="utf-8")
    result = run(
        pytester,
        f"""
def test_any(bench):
    assert bench.description.name == {sim.description.name!r}
    bench.device("signal_generator").sine(20.0, 1.0)

@pytest.mark.scene("noisy_lab")
def test_marked(bench):
    raise AssertionError

def test_scenic(scene):
    raise AssertionError

def test_fails(bench):
    raise AssertionError
""",
        "--bench=lab.toml",
        "-rs",
    )
    result.assert_outcomes(passed=1, skipped=2, failed=1)
    told = "\n".join(result.outlines)
    assert "needs a simulated bench, and --bench gives a real one" in told
    assert "::test_fails --bench lab.toml" in told


@pytest.mark.parametrize(
    ("marker", "complaint"),
    [
        ('"noisy_lap"', "unknown scene 'noisy_lap'*noisy_lab*"),
        ('"absent.toml"', "*absent.toml*"),
        ("seed=-1", "seed -1 is no whole number from 0 to 9223372036854775807*"),
        ("sed=1", "*unexpected keyword argument 'sed'"),
        ('faults=[{"kind": "bit_eror"}]', "*unknown fault 'bit_eror'*bit_error*"),
        ('faults=[{"kind": "bit_error", "on": "can", "at": "1 s"}]', "*unknown place of a bit_error 'can'*line*"),
    ],
)
def test_a_marker_that_names_nothing_is_a_usage_error(marker: str, complaint: str, pytester: pytest.Pytester) -> None:
    result = run(pytester, f"@pytest.mark.scene({marker})\ndef test_wrong(bench): pass")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["ERROR: *::test_wrong: marker scene: " + complaint])
    assert len(result.errlines) <= 2


def test_a_worker_fails_the_test_whose_marker_names_nothing(pytester: pytest.Pytester) -> None:
    pytester.makeconftest("def pytest_configure(config): config.workerinput = {}")
    wrong = '@pytest.mark.scene("noisy_lap")\ndef test_wrong(bench): pass\ndef test_right(): pass'
    result = run(pytester, wrong)
    result.assert_outcomes(errors=1, passed=1)
    result.stdout.fnmatch_lines(["*::test_wrong: marker scene: unknown scene 'noisy_lap'*"])
    assert "Traceback" not in "\n".join(result.outlines)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("-n2", "--bench=lab.toml"), "ERROR: --bench lab.toml: one bench cannot serve several workers; give -n0"),
        (("--bench=absent.toml", *ALONE), "ERROR: --bench: *absent.toml*"),
    ],
)
def test_a_real_bench_that_workers_would_share_or_whose_file_is_missing_is_a_usage_error(
    options: tuple[str, ...], complaint: str, pytester: pytest.Pytester
) -> None:
    pytester.makepyfile("def test_any(bench): pass")
    result = pytester.runpytest_inprocess(*options)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines([complaint])


STORES = """
import os
from pathlib import Path
import palpate

def test_what_is_stored_elsewhere_is_not_used_and_here_it_is_kept(tmp_path, worker_id):
    with palpate.open_bench(scene="ideal") as bench:
        before = palpate.run(palpate.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.2), bench, out=tmp_path / "before")
        made = palpate.run(palpate.LoadCellSeries(loads=(1.5, 4.0, 7.0)), bench)
        after = palpate.run(palpate.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.2), bench, out=tmp_path / "after")
    assert before.outcome["calibration"] == "thesis Table 5.1"
    assert after.outcome["calibration"] == made.folder.name
    (Path(__file__).parent / worker_id).write_text(os.environ["PALPATE_STORE"])
"""


@pytest.mark.slow
def test_a_run_of_tests_has_a_store_of_its_own_in_each_worker_and_leaves_the_callers_alone(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    callers = pytester.path / "callers"
    monkeypatch.setenv("PALPATE_STORE", str(callers))
    with palpate.open_bench(scene="ideal") as bench:
        palpate.run(palpate.LoadCellSeries(loads=(1.5, 4.0, 7.0)), bench)
    before = sorted(callers.rglob("*"))
    pytester.makepyfile(STORES)
    pytester.makefile(".ini", pytest="")
    assert pytester.runpytest_subprocess(*ALONE, "-p", "xdist", "--tx", "2*popen", "--dist", "each").ret == 0
    one, other = ((pytester.path / worker).read_text() for worker in ("gw0", "gw1"))
    assert one != other
    assert not Path(one).exists() and not Path(other).exists()
    assert sorted(callers.rglob("*")) == before


def test_the_plugin_costs_nothing_where_it_is_not_used() -> None:
    """Beside pytest it imports no module but its own."""
    code = "import sys, pytest; before = set(sys.modules); import palpate.procedures.testing"
    code += "; print(*set(sys.modules) - before)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {
        "palpate", "palpate.instrument", "palpate.instrument.arithmetic",  # chosen before numpy is loaded
        "palpate.procedures", "palpate.procedures.testing",
    }  # fmt: skip
