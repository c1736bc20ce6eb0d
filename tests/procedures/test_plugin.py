"""The pytest plugin gives each test a bench of its own, says what went on when it fails, and refuses what cannot be."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy.fft  # noqa: F401  (it can be loaded once, and what a test with `pytester` imports is forgotten with it)
import pytest

import palpate
import palpate.procedures.testing.benches
from palpate.simulators.bench import SimulatedBench

pytest_plugins = ["pytester"]
ALONE = (
    "--disable-plugin-autoload",
    "-p",
    "palpate.procedures.testing",
)  # other plugins would be imported again each time
pytestmark = pytest.mark.usefixtures("nothing_left_behind")


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
