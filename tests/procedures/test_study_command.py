"""`palpate study`: cells in closed form and on the bench, in processes of their own, and what is wrong with a study."""

from __future__ import annotations

import itertools
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from palpate.instrument.config import parse
from palpate.instrument.errors import PalpateError, UsageError
from palpate.procedures.study.description import StudyFile, study_of
from palpate.procedures.study.run import BlockBuilder, attempt, stored
from palpate.procedures.virtual import study_cell
from palpate.procedures.virtual.study_cell import COLUMNS, StudyComputation
from palpate.simulators.planning.settle import read_scene
from tests.procedures.conftest import Palpate, sweep_scene
from tests.shares import first_of

LOADS = (2.0, 3.0)


def sweep_of(axes: str, how: str = "closed form") -> StudyComputation:
    text = f'name = "study"\nhow = "{how}"\nloads = "2 N, 3 N"\n[axes]\n{axes}'
    return StudyComputation.of(study_of(parse(text.encode(), StudyFile, "study.toml"), "study.toml"), "study.toml")


def points(sweep: StudyComputation, **cell: Any) -> list[dict[str, Any]]:
    return sweep({"scene": "thesis_single", "sample": "1", "seed": 3, **cell})


def test_without_noise_and_scatter_the_closed_form_measures_what_the_model_says() -> None:
    for design, sample in (("single", "1"), ("common_base", "2")):
        found = points(sweep_of('scene = ["ideal"]'), scene="ideal", design=design, sample=sample)
        assert [point["load_N"] for point in found] == list(LOADS)
        for point in found:
            assert point["force_ratio"] == pytest.approx(point["model_force_ratio"], rel=2e-3)  # steps of 16 bits
            assert point["force_total_N"] == pytest.approx(point["load_N"], rel=1e-4)


def test_scatter_is_drawn_anew_for_each_load_set_and_by_the_seed() -> None:
    sweep = sweep_of("seed = [3, 6]")
    first, other = points(sweep), points(sweep, seed=6)
    assert points(sweep) == first
    for one, two in itertools.combinations((*first, *other), 2):
        assert abs(one["force_ratio"] - two["force_ratio"]) > 3 * math.hypot(one["noise_u"], two["noise_u"])
    off = [(p["force_ratio"] - p["model_force_ratio"]) / p["force_ratio_u"] for p in (*first, *other)]
    assert 0.1 < math.sqrt(sum(z * z for z in off) / len(off)) < 2.5


@pytest.mark.parametrize("how", first_of(["closed form", "bench"]))
def test_samples_of_one_seed_share_neither_gains_nor_noise(how: str) -> None:
    sweep = sweep_of("seed = [3]\nsample = ['1', '2']", how)
    off = [[p["force_ratio"] / p["model_force_ratio"] - 1 for p in points(sweep, sample=name)] for name in ("1", "2")]
    for one, two in itertools.product(*off):
        assert abs(one - two) > 1e-4  # the gains are 4 % of it


def test_a_cell_on_the_bench_is_the_sweep_on_that_bench(tmp_path: Path) -> None:
    found = points(sweep_of("seed = [3]", "bench"))
    scene = read_scene("thesis_single").with_seed(found[0]["scene_seed"])
    result = sweep_scene(scene, tmp_path, samples=("1",), loads=LOADS)
    assert [[point[name] for name in COLUMNS] for point in found] == [
        [getattr(point, name) for name in COLUMNS] for point in result.points
    ]


@pytest.mark.parametrize(
    ("cell", "reason"),
    [
        ({"scene": "overdriven"}, r"scene 'overdriven' has no closed form under 3 N: the amplifier clips; take how ="),
        ({"scene": "faulty.toml"}, "scene 'faulty' has faults, which only a bench meets; take how = 'bench'"),
        ({"modulus": "1 MPa"}, "modulus 1 MPa of sample '2' is outside the measured"),
        ({"design": "array_16"}, "nothing was measured with design 'array_16'; take model 'column'"),
        (
            {"effects.white_noise.density": "-1 V/√Hz"},
            "thesis_single: effects.white_noise: density: -1.0 is too small",
        ),
    ],
)
def test_a_cell_that_cannot_be_says_why(
    cell: dict[str, Any], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ideal = 'name = "faulty"\npurpose = "Faults."\ndesign = "single"\n'
    fault = '[[fault]]\non = "shaker_amplifier"\nkind = "over_current"\nat = "1 s"\n'
    Path("faulty.toml").write_text(ideal + fault, encoding="utf-8")
    sweep = sweep_of('scene = ["thesis_single", "overdriven", "faulty.toml"]')
    builder = BlockBuilder(7, 1, len(LOADS))
    attempt(builder, 0, lambda: sweep({"scene": "thesis_single", "sample": "2", **cell}))
    block = builder.block()
    assert block.reasons[0].startswith(reason)
    assert not block.columns


@pytest.mark.parametrize(
    ("axes", "complaint"),
    [
        ('scene = ["thesis_singel"]', r"unknown scene 'thesis_singel' \(did you mean 'thesis_single'\?\)"),
        ("effects.white_nois.density = [1]", r"effects.white_nois.density: unknown effect .* \(did you mean 'white_n"),
        ("effects.white_noise.densty = [1]", r"unknown parameter .* 'densty' \(did you mean 'density'\?\)"),
        ("effects.white_noise = [1]", "unknown parameter of the effect white_noise ''"),
    ],
)
def test_a_scene_or_an_effect_that_does_not_exist_is_refused(axes: str, complaint: str) -> None:
    with pytest.raises(PalpateError, match=complaint):
        sweep_of(axes)


STUDY = """
name = "small"
loads = "2 N, 3 N"

[axes]
scene = ["thesis_single", "overdriven"]
seed = "1-2"
"""


@contextmanager
def threads(*_: object) -> Iterator[tuple[Executor, int]]:
    """In place of processes, which take a second to begin."""
    with ThreadPoolExecutor(2) as executor:
        yield executor, 2


def test_the_second_call_computes_nothing_and_says_the_same(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_cell, "executor_of", threads)
    Path("small.toml").write_text(STUDY, encoding="utf-8")
    asked = ("study", "small.toml", "--out", "out")
    spoken = palpate(*asked, "--json")
    first = json.loads(spoken.out)
    assert (spoken.status, first["simulated"], first["one_by_one"]) == (1, True, {})
    assert (first["cells"], first["done"], [each["cell"] for each in first["failed"]]) == (4, 4, [2, 3])
    assert "amplifier clips" in first["failed"][0]["reason"]
    assert first["results"][0]["force_ratio"] == pytest.approx(0.142, rel=0.1)
    monkeypatch.setattr(study_cell, "executor_of", lambda *_: pytest.fail("nothing is left to compute"))
    assert json.loads(palpate(*asked, "--json").out) == first
    shown = palpate(*asked).out  # as people are told
    assert "cell 2 failed: " in shown and "mean force ratio" in shown and "out, 4 of 4 cells" in shown


def test_what_is_wrong_is_told_before_anything_is_computed(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("small.toml").write_text(STUDY, encoding="utf-8")
    Path("wrong.toml").write_text(STUDY.replace("thesis_single", "thesis_singel"), encoding="utf-8")
    Path("lab").mkdir()
    Path("lab/plot.png").write_text("of a run")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for words, complaint in (
        (("wrong.toml",), "unknown scene 'thesis_singel' (did you mean 'thesis_single'?)"),
        (("small.toml", "--out", "lab"), "lab holds other files; choose a new or empty folder"),
        (("small.toml", "--to", "parquet"), "give: pip install 'palpate[parquet]'"),
        (("small.toml", "--workers", "2", "--dask", "tcp://127.0.0.1:1"), "--workers and --dask: the scheduler has"),
    ):
        said = palpate("study", *words)
        assert (said.status, complaint in said.complaint) == (2, True), said
    assert palpate("study", "small.toml", "--workers", "0").status == 2
    assert ([path.name for path in Path("lab").iterdir()], Path("runs").exists()) == (["plot.png"], False)


# --- as a process --------------------------------------------------------------------------------------

PATIENCE = 120.0  # s


def kept(folder: Path) -> int:
    with suppress(UsageError):  # not begun yet
        return sum(map(len, stored(folder)[1]))
    return 0


def wait_for(true: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end
        threading.Event().wait(0.05)


def workers_of(group: int) -> list[str]:
    """Processes that are left of a process group."""
    left = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = status.read_text(encoding="utf-8").rpartition(")")[2].split()
            if int(fields[2]) == group and fields[0] != "Z":
                left.append(status.parent.name)
    return left


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_a_stopped_study_keeps_its_cells_and_leaves_no_worker(
    number: signal.Signals, status: int, tmp_path: Path
) -> None:
    file, folder = tmp_path / "study.toml", tmp_path / "out"
    file.write_text('name = "large"\nloads = "2 N, 3 N"\n[axes]\nseed = "1-500000"\n', encoding="utf-8")
    palpate = str(Path(sys.executable).with_name("palpate"))
    command = [palpate, "study", str(file), "--workers", "1", "--out", str(folder)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    wait_for(lambda: kept(folder) >= 2)
    before = kept(folder)
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # as a terminal does
    else:
        os.kill(process.pid, number)
    _, said = process.communicate(timeout=PATIENCE)
    after = kept(folder)
    assert (process.returncode, before <= after < 500_000) == (status, True)
    if number == signal.SIGINT:
        told = f"{after} of 500000 cells are kept in {folder}; give the command again to go on"
        assert said.lstrip() == f"palpate: interrupted\n{told}\n"
    wait_for(lambda: not workers_of(process.pid))
