"""The same bytes on another processor; and where the arithmetic is another, what is told and what still works."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate import LoadSweep, Run, open_bench, run
from palpate.extend import Recorder
from palpate.instrument.arithmetic import KERNELS, alike, arithmetic, same_arithmetic
from palpate.instrument.models.response import RatioQuestion, ask
from tests.procedures.conftest import HEADER, Palpate, interrupt_at
from tests.runs import rehash

SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--quiet")
LAST_DIGIT, TOO_FAR = 1 + 4e-16, 1 + 1e-5

CPU = Path("/proc/cpuinfo")
PROCESSOR = CPU.read_text(encoding="utf-8", errors="replace") if CPU.exists() else ""

x86_64 = pytest.mark.skipif(platform.machine() != "x86_64", reason="OpenBLAS has these kernels for x86-64 alone")


def digest(folder: Path, kernel: str, threads: str, without: str = "") -> tuple[str, dict[str, Any]]:
    """Digest and arithmetic of a sweep in a process that is told to sum by these kernels, `without` these of numpy."""
    code = "from palpate.procedures.commands import main; main()"
    command = (sys.executable, "-c", code, *SWEEP, "--scene", "thesis_single", "--out", str(folder))
    kernels = {"OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": threads, "NPY_DISABLE_CPU_FEATURES": without}
    subprocess.run(command, env={**os.environ, **kernels}, check=True, cwd=folder.parent, timeout=50)
    run: Any = Run.open(folder)
    return run.digest(), run.header["arithmetic"]


SCRIPT = """
import sys
import palpate
with palpate.open_bench(scene="thesis_single", seed=4) as bench:
    palpate.run(palpate.LoadSweep(samples=("1",), loads=(2.0, 3.0), dwell=0.2), bench, out=sys.argv[1])
"""


def scripted(folder: Path, script: str) -> Run:
    """The run of a script in a process of its own, which inherits no kernels from this one."""
    own = {name: value for name, value in os.environ.items() if name not in KERNELS}
    command = (sys.executable, "-c", script, str(folder))
    subprocess.run(command, env=own, check=True, cwd=folder.parent, timeout=50)
    return Run.open(folder)


@x86_64
@pytest.mark.slow
def test_command_script_and_test_give_the_same_bytes_and_numpy_first_gives_the_same_signals(tmp_path: Path) -> None:
    script, numpy = scripted(tmp_path / "script", SCRIPT), scripted(tmp_path / "numpy", "import numpy" + SCRIPT)
    command = (sys.executable, "-c", "from palpate.procedures.commands import main; main()", *SWEEP, "--seed", "4")
    subprocess.run([*command, "--out", str(tmp_path / "command")], check=True, cwd=tmp_path, timeout=50)
    with open_bench(scene="thesis_single", seed=4) as bench:
        run(LoadSweep(samples=("1",), loads=(2.0, 3.0), dwell=0.2), bench, out=tmp_path / "test")
    test = Run.open(tmp_path / "test")
    assert script.header["arithmetic"] == test.header["arithmetic"] == arithmetic()
    assert "Nehalem, 1 threads" in arithmetic()["blas"]
    assert arithmetic()["vectors"] == "X86_V2"
    assert script.digest() == test.digest() == Run.open(tmp_path / "command").digest()
    assert numpy.signal_digest() == script.signal_digest()


def test_the_digest_of_signals_is_of_settings_times_and_samples_and_of_no_result(tmp_path: Path) -> None:
    def digests(name: str, *, ratio: float = 0.3, volt: float = 1.0, load: float = 2.0) -> tuple[str, str]:
        with Recorder.create(tmp_path / name, {**HEADER, "settings": {"loads": [load]}}) as record:
            record.point({"force_ratio": ratio}, {"rigid": (250.0, np.full(5, volt))}, 7)
            record.finish("complete", {})
        done = Run.open(tmp_path / name)
        return done.digest(), done.signal_digest()

    digest, signals = digests("one")
    assert digests("again") == (digest, signals)
    other, same = digests("ratio", ratio=0.3 * LAST_DIGIT)
    assert (other != digest, same) == (True, signals)
    assert digests("volt", volt=1.1)[1] != signals != digests("load", load=3.0)[1]


@x86_64
@pytest.mark.slow
def test_kernels_of_several_processors_give_the_same_bytes(tmp_path: Path) -> None:
    one = digest(tmp_path / "one", "Haswell", "2")
    assert digest(tmp_path / "other", "Prescott", "1", without="X86_V4 AVX512_ICL AVX512_SPR") == one
    assert "Nehalem, 1 threads" in one[1]["blas"]
    assert one[1]["vectors"] == "X86_V2"


@pytest.mark.slow
@pytest.mark.skipif(
    "avx2" not in PROCESSOR, reason="this processor has no kernels but those that are the same anywhere"
)
def test_a_solid_of_many_teeth_takes_the_processors_own_kernels_and_says_so(tmp_path: Path) -> None:
    found = {}
    for design in ("array", "single"):
        asked = ("model", "ratio", "--json", "--model", "solid", "--design", design, "--sensed-modulus", "1 MPa")
        asked += ("--tolerance", "3 %")  # the unit is read by a library that loads numpy
        command = (sys.executable, "-c", "from palpate.procedures.commands import main; main()", *asked)
        env = {**os.environ, "PALPATE_CURVES": str(tmp_path)}
        found[design] = json.loads(
            subprocess.run(command, env=env, capture_output=True, check=True, timeout=300).stdout
        )
    assert found["single"]["arithmetic"] == arithmetic()
    assert found["array"]["arithmetic"]["vectors"] != arithmetic()["vectors"]
    (point,) = found["array"]["points"]
    (surface,) = ask(RatioQuestion("array", "surface"), [1e6])
    bound = point["error_estimate"] + surface.response.error_estimate
    assert point["force_ratio"] == pytest.approx(surface.response.force_ratio, rel=bound)


def test_another_processor_with_the_same_kernels_is_the_same_arithmetic_and_other_kernels_are_not() -> None:
    now = arithmetic()
    assert same_arithmetic({**now, "processor": "another"}, now)
    assert not same_arithmetic({**now, "blas": "openblas 0.3 Haswell, 1 threads"}, now)


@pytest.mark.parametrize(
    ("before", "now", "same"),
    [
        (1.0, LAST_DIGIT, True),
        (1.0, TOO_FAR, False),
        ([3e-17, 1.0], [-5e-17, 1.0], True),  # rounding alone, beside a number of size
        ([3e-11, 1.0], [5e-11, 1.0], False),
        ({"a": [1.0, "x", None, True]}, {"a": [LAST_DIGIT, "x", None, True]}, True),
        ({"a": 1.0}, {"a": 1.0, "b": 1.0}, False),
        (2, 3, False),
        ([1.0], [1.0, 1.0], False),
        (1.0, None, False),
        ("valid", "clipped", False),
    ],
)
def test_values_are_alike_where_numbers_differ_by_their_last_digits_only(before: Any, now: Any, same: bool) -> None:
    assert alike(before, now) is same


@pytest.fixture
def cut(palpate: Palpate, on_progress: Any) -> Callable[..., Any]:
    """Resumes a run that was stopped at its first point, with another arithmetic and another point in its record."""

    def resume(factor: float, **other: str) -> Any:
        on_progress(interrupt_at(1))
        assert palpate(*SWEEP, "--out", "cut").status == 130
        on_progress(lambda *_: None)

        def changed(point: dict[str, Any]) -> None:
            point["force_ratio"] *= factor

        rehash(Path("cut"), header=lambda header: header["arithmetic"].update(other), point=changed, number=1)
        return palpate("runs", "resume", "cut", "--quiet")

    return resume


def test_a_run_goes_on_under_another_arithmetic_and_says_so(cut: Callable[..., Any]) -> None:
    assert cut(LAST_DIGIT, blas="openblas 0.3 Haswell, 8 threads").status == 0
    run = Run.open(Path("cut"))
    assert (run.status, len(run.points())) == ("complete", 2)
    assert {"machine", "processor", "blas", "vectors", "libm"} == arithmetic().keys()
    assert all(arithmetic()[key] for key in ("machine", "blas", "vectors", "libm"))
    (told,) = [event["message"] for event in run.events() if event["kind"] == "changed"]
    assert "Haswell, 8 threads" in told and "compared to 1e-06 of each number" in told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "other"), [(TOO_FAR, {"blas": "openblas 0.3 Haswell, 8 threads"}), (LAST_DIGIT, {})]
)
def test_another_result_is_refused_under_another_arithmetic_and_another_digit_under_the_same(
    cut: Callable[..., Any], factor: float, other: dict[str, str]
) -> None:
    assert "point 1 is not what the bench gives now" in cut(factor, **other).complaint
