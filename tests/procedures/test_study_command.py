"""`palpate study`: cells in closed form, on the bench, as arrays, in processes of their own; what is wrong with one."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.instrument.config import parse
from palpate.instrument.errors import PalpateError, UsageError
from palpate.procedures.study.description import Study, StudyFile, study_of
from palpate.procedures.study.run import BlockBuilder, CellBlock, attempt, one_by_one, stored
from palpate.procedures.virtual import study_cell
from palpate.procedures.virtual.study_cell import COLUMNS, StudyComputation
from palpate.simulators.planning import seeds
from palpate.simulators.planning.settle import read_scene
from tests.procedures.conftest import Palpate, sweep_scene
from tests.procedures.studies import study_from
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


@pytest.mark.parametrize("how", first_of(["closed form", "bench"]))
def test_samples_of_one_seed_share_neither_gains_nor_noise(how: str) -> None:
    sweep = sweep_of("seed = [3]\nsample = ['1', '2']", how)
    off = [[p["force_ratio"] / p["model_force_ratio"] - 1 for p in points(sweep, sample=name)] for name in ("1", "2")]
    assert min(abs(one - two) for one, two in itertools.product(*off)) > 1e-4  # the gains are 4 % of it


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
    fault = '[[fault]]\non = "shaker_amplifier"\nkind = "over_current"\nat = "1 s"\n'
    Path("faulty.toml").write_text(
        f'name = "faulty"\npurpose = "Faults."\ndesign = "single"\n{fault}', encoding="utf-8"
    )
    sweep = sweep_of('scene = ["thesis_single", "overdriven", "faulty.toml"]')
    builder = BlockBuilder(7, 1, len(LOADS))
    attempt(builder, 0, lambda: sweep({"scene": "thesis_single", "sample": "2", **cell}))
    assert builder.block().reasons[0].startswith(reason)
    assert not builder.block().columns


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


# --- cells of one scene, computed together as arrays --------------------------------------------------


def asked(axes: str, loads: str, more: str = "") -> tuple[Study, StudyComputation]:
    study = study_from(f'name = "arrays"\nloads = "{loads}"\n{more}\n[axes]\n{axes}\n')
    return study, StudyComputation.of(study, "study.toml")


def contents(block: CellBlock) -> dict[str, object]:
    """All that is stored of a block but what tells how it was computed."""
    points = {name: (column.dtype, column[block.done].tobytes()) for name, column in block.columns.items()}
    return {**points, "reasons": block.reasons, "means": block.means.tobytes()}


CASES = {
    "seeds and samples": ('seed = "1-12"\nsample = ["1", "6"]', "1.5 N:4 N:0.5 N", ""),
    "every effect at the inputs": ('scene = ["noisy_lab"]\nseed = "5-12"', "1.5 N, 3 N", ""),
    "leaks and warming": ('scene = ["humid_body", "long_drift"]\nseed = "1-4"', "1 N, 2 N, 2 N", ""),
    "common base": ('scene = ["thesis_common_base"]\nseed = "1-4"', "1 N, 4 N", ""),
    "an array on five nodes": ('scene = ["array_16"]\nmodel = ["column"]\nseed = "1-4"', "2 N", ""),
    "no scatter": ('scene = ["ideal"]\nseed = "1-4"', "1 N, 2 N", ""),
    "gains by mounting": ('effects.gain_scatter.redrawn = ["mounting"]\nseed = "1-4"', "1 N, 2 N, 2 N", ""),
    "films that share forces": (
        'effects.crosstalk.over_teeth = [0.5]\nscene = ["thesis_common_base"]\nseed = "1-4"', "2 N", "",
    ),
    "clipped in the fine range": ('effects.mains_hum.amplitude = ["0.49 V"]\nseed = "1-4"', "2 N, 4 N", ""),
    "clipped in both": ('effects.mains_hum.amplitude = ["5 V"]\nseed = "1-4"', "2 N, 4 N", ""),
    "a coarse converter": ('effects.adc.bits = [8]\nseed = "1-4"', "2 N, 4 N", ""),
    "short records": ('scene = ["noisy_lab"]\nseed = "1-8"', "2 N, 3 N", 'dwell = "0.3 s"'),
    "hum off its rated frequency": ('effects.mains_hum.frequency = ["50.4 Hz"]\nseed = "1-4"', "2 N, 3 N", ""),
    "some without a ratio": ('effects.white_noise.density = ["5 mV/√Hz"]\nseed = "1-8"', "1 N, 2 N", 'dwell = "0.3 s"'),
    "limits that act": ('scene = ["overdriven"]\nseed = "1-4"', "2 N, 3 N", ""),
    "a time constant of a minute": (
        'effects.charge_amplifier.time_constant = ["60 s"]\nseed = "1-4"', "1 N:4 N:0.5 N", "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", first_of([*CASES]))
def test_arrays_are_to_the_last_bit_what_single_cells_are(case: str) -> None:
    axes, loads, more = CASES[case]
    study, computation = asked(axes, loads, more)
    together = computation.block(study, range(len(study)))
    alone = one_by_one(computation, study, range(len(study)))
    assert contents(together) == contents(alone)
    assert set(together.alone) == {""}


@pytest.mark.parametrize("pieces", [[1] * 9, [4, 5]])
def test_the_results_do_not_depend_on_how_cells_are_put_together(pieces: list[int]) -> None:
    study, computation = asked('seed = "1-3"\nsample = ["1", "2", "3"]', "2 N")
    whole = computation.block(study, range(9))
    blocks = [computation.block(study, range(sum(pieces[:n]), sum(pieces[: n + 1]))) for n in range(len(pieces))]
    for name, column in whole.columns.items():
        assert b"".join(block.columns[name].tobytes() for block in blocks) == column.tobytes()


def test_most_cells_are_sure_and_one_on_the_edge_of_a_step_is_computed_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    study, computation = asked('seed = "1-6"', "2 N")
    followed: Counter[str] = Counter()
    monkeypatch.setattr(
        StudyComputation,
        "__call__",
        lambda self, cell, was=StudyComputation.__call__: followed.update("x") or was(self, cell),
    )
    sure = computation.block(study, range(6))
    assert not followed
    # The margin is now a quarter of a step, so that a sample of every cell lies in it.
    monkeypatch.setattr(seeds, "ROUND_OFF", 2.0**-17)
    unsure = computation.block(study, range(6))
    assert followed["x"] == 6
    assert contents(unsure) == contents(sure)


def test_an_effect_that_is_not_linear_in_what_a_seed_draws_is_named() -> None:
    study, computation = asked('effects.mounting_scatter.scatter = [0.02]\nseed = "1-4"', "2 N")
    block = computation.block(study, range(4))
    assert set(block.alone) == {"mounting_scatter"}
    assert contents(block) == contents(one_by_one(computation, study, range(4)))
    assert len(np.unique(block.means[:, 0])) == 4


@pytest.mark.parametrize(("samples", "cause"), [(4, ""), (5, "few cells share a scene")])
def test_cells_of_many_scenes_with_few_seeds_each_are_computed_alone_and_that_is_told(samples: int, cause: str) -> None:
    names = ", ".join(f'"{sample}"' for sample in range(1, samples + 1))
    study, computation = asked(f'seed = "1-2"\nsample = [{names}]\neffects.gain_scatter.strength = [0.5, 1.0]', "2 N")
    assert set(computation.block(study, range(len(study))).alone) == {cause}
