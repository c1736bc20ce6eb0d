"""A study gives the same results whatever computes it and however often it was stopped; and `palpate study`."""

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
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.instrument.config import parse
from palpate.instrument.errors import BenchError, ConfigError, PalpateError, RangeError, RecordError, UsageError
from palpate.procedures.console.terminal import silent
from palpate.procedures.study.description import MOST_CELLS, Study, StudyFile, Value, read_study, study_of
from palpate.procedures.study.results import Results, coordinate, plot_study, print_study, read_results
from palpate.procedures.study.run import (
    RECORD,
    BlockBuilder,
    CellBlock,
    Evaluate,
    Store,
    attempt,
    one_by_one,
    run,
    stored,
)
from palpate.procedures.virtual import study_cell
from palpate.procedures.virtual.study_cell import COLUMNS, StudyComputation
from palpate.simulators.planning import seeds
from palpate.simulators.planning.settle import read_scene
from tests.procedures.conftest import Palpate, sweep_scene
from tests.procedures.studies import GRID, RANDOM, study_from
from tests.shares import first_of

Cell = Mapping[str, Value]


def evaluate(cell: Cell) -> Iterator[dict[str, Any]]:
    """Two load sets that say which cell they are of; the far scene is bad under seed 2, and a defect under seed 3."""
    if cell["scene"] == "far" and cell["seed"] == 2:
        raise RangeError("the far scene is too far; go nearer")
    if cell["scene"] == "far" and cell["seed"] == 3:
        raise ZeroDivisionError("a defect")
    for load in (1.0, 2.0):
        ratio = int(cell["seed"]) / 10 + int(cell["sample"]) / 100
        yield {
            "load_N": load, "force_ratio": ratio, "force_ratio_u": 0.03 * load, "noise_u": 0.0, "pickup_u": 0.0,
            "degrees_of_freedom": None, "model_force_ratio": 0.5, "valid": load < 2 or cell["seed"] != 1, "flags": [],
        }  # fmt: skip


class InTurn(Executor):
    """Computes in this thread, and says that the last is ready first."""

    def __init__(self, of: int = 12) -> None:
        self.begun: list[int] = []
        self.waiting: list[tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]] = []
        self.left = of

    def submit(self, call: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.begun.extend(arguments[-1])
        self.left -= len(arguments[-1])
        self.waiting.append((future, call, arguments))
        if len(self.waiting) == 4 or not self.left:
            while self.waiting:
                later, call, arguments = self.waiting.pop()
                self.answer(later, call, arguments)
        return future

    def answer(self, future: Future[Any], call: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        future.set_result(call(*arguments))


def done(folder: Path, executor: Executor, asked: str = GRID, evaluate: Evaluate = evaluate) -> Results:
    study = study_from(asked)
    with Store(folder, {"study": study.file.model_dump(mode="json")}) as store, executor:
        run(study, partial(one_by_one, evaluate), executor, store, silent, ahead=4)
    return read_results(folder)


@pytest.fixture
def whole(tmp_path: Path) -> Results:
    return done(tmp_path / "whole", ThreadPoolExecutor(1))


def test_the_results_are_the_same_bytes_whatever_computes_them(whole: Results, tmp_path: Path) -> None:
    for name, executor in {"threads": ThreadPoolExecutor(4), "in turn": InTurn()}.items():
        results = done(tmp_path / name, executor)
        assert results.digest() == whole.digest()
        csv = [each.export("csv", tmp_path / folder) for each, folder in ((results, name), (whole, "whole"))]
        assert csv[0].read_bytes() == csv[1].read_bytes()


def test_a_bad_cell_fails_with_its_reason_and_the_others_go_on(whole: Results) -> None:
    too_far, defect = "the far scene is too far; go nearer", "ZeroDivisionError: a defect"
    assert whole.tally().failed == {8: too_far, 9: too_far, 10: defect, 11: defect}
    assert [mean.cell for mean in whole.means()] == list(range(12))


def test_a_cell_that_is_stored_is_not_computed_again(whole: Results, tmp_path: Path) -> None:
    def stopped(cell: Cell) -> Any:
        if cell["scene"] == "far":
            raise KeyboardInterrupt
        return evaluate(cell)

    folder = tmp_path / "stopped"
    with pytest.raises(KeyboardInterrupt) as interrupted:
        done(folder, ThreadPoolExecutor(1), evaluate=stopped)
    kept = [mean.cell for mean in read_results(folder).means()]
    assert kept == list(range(len(kept))) and 1 <= len(kept) <= 6  # of a block in which it was stopped no cell is kept
    stand = f"{len(kept)} of 12 cells are kept in {folder}; give the command again to go on"
    assert interrupted.value.__notes__ == [stand]
    again = InTurn(of=12 - len(kept))
    assert (done(folder, again).digest(), again.begun) == (whole.digest(), list(range(len(kept), 12)))


def test_of_a_worker_that_is_lost_only_its_block_is(whole: Results, tmp_path: Path) -> None:
    class Losing(InTurn):
        def answer(self, future: Future[Any], call: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
            if 2 in arguments[-1]:
                future.set_exception(BrokenExecutor("it is gone"))
            else:
                super().answer(future, call, arguments)

    with pytest.raises(BenchError, match=r"^a worker ended without an answer \(it is gone\).* 3 of 12 cells are kept"):
        done(tmp_path / "lost", Losing())
    assert [mean.cell for mean in read_results(tmp_path / "lost").means()] == [0, 1, 3]
    assert done(tmp_path / "lost", InTurn(of=9)).digest() == whole.digest()  # the hole is filled


@pytest.mark.parametrize(
    ("old", "new", "difference"),
    [
        ('"1-3"', '"1-4"', "study.axes.seed is '1-3' there and '1-4' here"),
        ("2 N", "3 N", "study.loads is '1 N, 2 N' there and '1 N, 3 N' here"),
        ('sample = ["1", "2"]', "", r"study.axes.sample is \['1', '2'\] there and absent here"),
    ],
)
def test_another_study_is_refused_with_what_differs(
    old: str, new: str, difference: str, whole: Results, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=f"whole holds another study: {difference}; choose another --out"):
        done(tmp_path / "whole", InTurn(), GRID.replace(old, new))


@pytest.mark.parametrize("at", ["a row", "the file", "its end"])
def test_a_damaged_study_or_one_that_was_cut_off_is_told(at: str, whole: Results, tmp_path: Path) -> None:
    path = tmp_path / "whole" / RECORD
    content = path.read_bytes()
    row, other = (np.float64(ratio).tobytes() for ratio in (0.11, 0.12))
    damaged = {
        "a row": content.replace(row, other, 1),
        "the file": b"x" * 4096,
        "its end": content.rstrip(b"\0")[:-2000],
    }
    path.write_bytes(damaged[at])
    assert damaged[at] != content
    with pytest.raises(RecordError, match=r"study\.record is damaged \(.*\); restore it from a copy"):
        read_results(tmp_path / "whole").digest()
    if at == "its end":
        with pytest.raises(
            RecordError, match=r"some of its .* rows are missing, .*, or remove its folder to begin again"
        ):
            done(tmp_path / "whole", InTurn())


def test_one_process_at_a_time_works_on_a_study_which_others_can_read(whole: Results, tmp_path: Path) -> None:
    folder, header = tmp_path / "whole", {"study": whole.study.file.model_dump(mode="json")}
    for _ in range(2):
        with Store(folder, header):
            assert read_results(folder).tally().cells == 12
            with pytest.raises(UsageError, match="is being worked on by another process"):
                Store(folder, header)


def test_a_folder_that_holds_no_study_or_cannot_hold_one_is_told(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds no study"):
        read_results(tmp_path)
    (tmp_path / "taken").touch()
    with pytest.raises(RecordError, match=r"cannot write .*taken.study\.record: .*; choose a writable folder"):
        Store(tmp_path / "taken", {})


def test_a_study_whose_cells_all_fail_has_an_empty_table(tmp_path: Path) -> None:
    results = done(tmp_path, ThreadPoolExecutor(1), GRID.replace('"near", "far"', '"far"').replace('"1-3"', "[2]"))
    assert [mean.force_ratio for mean in results.means()] == [None, None]
    assert all(results.export(to, tmp_path).exists() for to in ("csv", "parquet"))
    assert plot_study(results, tmp_path).exists()
    assert results.dataset().reason.sel(sample="1").item() == "the far scene is too far; go nearer"


def test_a_mean_is_over_the_valid_load_sets_and_a_group_holds_what_differs_in_seeds_alone(whole: Results) -> None:
    (first, _, second, *_), groups = whole.means(), whole.groups()
    assert (first.valid_points, first.force_ratio, first.force_ratio_u) == (1, 0.11, 0.03)
    assert (second.valid_points, second.force_ratio_u) == (2, pytest.approx((0.03**2 + 0.06**2) ** 0.5 / 2))
    assert [(group.axes["scene"], group.axes["sample"], group.cells, group.failed) for group in groups] == [
        ("near", "1", 3, 0), ("near", "2", 3, 0), ("far", "1", 3, 2), ("far", "2", 3, 2),
    ]  # fmt: skip
    assert (groups[0].spread, groups[2].spread) == (pytest.approx(0.1), None)


def test_people_are_shown_a_group_a_line_what_failed_and_where_the_files_are(
    whole: Results, capsys: pytest.CaptureFixture[str]
) -> None:
    failed = [{"cell": number, "reason": f"reason {number}"} for number in range(7)]
    files = {"study": "out", "points": "out/points.csv", "plot": "out/plot.png"}
    print_study(whole, {**files, "cells": 12, "done": 12, "failed": failed, "one_by_one": {"mounting_scatter": 7}})
    shown = capsys.readouterr().out
    lines = [line.split() for line in shown.splitlines()]
    (heads,) = [line for line in lines if line[-1:] == ["model"]]
    assert heads[-6:] == ["cells", "failed", "ratio", "spread", "u", "model"]
    rows = [line for line in lines if line[:1] in (["near"], ["far"])]
    groups = [["near", "1", "3"], ["near", "2", "3"], ["far", "1", "3"], ["far", "2", "3"]]
    assert ([row[:3] for row in rows], [row[3] for row in rows[2:]]) == (groups, ["2", "2"])
    group = whole.groups()[0]
    numbers = [group.force_ratio, group.spread, group.force_ratio_u, group.model_force_ratio]
    assert [float(text) for text in rows[0][-4:]] == pytest.approx(numbers, rel=0.05)
    assert "cell 4 failed: reason 4" in shown and "cell 5 failed" not in shown
    assert "and 2 cells more failed: see --json" in shown and "SIMULATED" in shown
    assert "out, 12 of 12 cells" in shown and "out/points.csv" in shown and "out/plot.png" in shown
    assert "7 cells were computed one by one, because of the effect mounting_scatter" in shown


def test_the_dataset_of_a_grid_has_its_axes_and_the_table_its_values(whole: Results) -> None:
    found, table = whole.dataset(), whole.table()
    assert found.force_ratio.dims == ("scene", "seed", "sample", "load_N")
    assert float(found.force_ratio.sel(scene="near", seed=3, sample="2", load_N=2.0)) == 0.32
    assert found.force_ratio.sel(scene="far", seed=[2, 3]).isnull().all()
    assert str(found.reason.sel(scene="far", seed=3, sample="1").item()) == "ZeroDivisionError: a defect"
    row = table[(table.scene == "near") & (table.seed == 3) & (table["sample"] == "2") & (table.load_N == 2.0)]
    assert (row.force_ratio.tolist(), len(table), table.simulated.all()) == ([0.32], 16, True)


def test_the_dataset_of_draws_goes_by_cells(tmp_path: Path) -> None:
    def modulus(cell: Cell) -> list[dict[str, Any]]:
        ratio = float(str(cell["modulus"]).split()[0])
        return [{**point, "force_ratio": ratio} for point in evaluate({**cell, "scene": "near"})]

    asked = f'loads = "1 N, 2 N"\n{RANDOM.lstrip()}'
    results = done(tmp_path / "drawn", ThreadPoolExecutor(1), asked, modulus)
    found = results.dataset()
    assert (found.force_ratio.dims, found.modulus.attrs) == (("cell", "load_N"), {"units": "kPa"})
    assert found.force_ratio.isel(load_N=0).values.tolist() == found.modulus.values.tolist()
    assert "modulus_kPa" in results.table().columns


# --- the file of a study --------------------------------------------------------------------------------


def test_a_grid_has_every_combination_and_the_last_axis_goes_fastest() -> None:
    study = study_from(GRID.replace('sample = ["1", "2"]', 'sample = "1-4"'))
    assert (len(study), study.cell(0)) == (24, {"scene": "near", "seed": 1, "sample": "1"})
    assert study.cell(7) == {"scene": "near", "seed": 2, "sample": "4"}
    assert study.cell(12) == {"scene": "far", "seed": 1, "sample": "1"}
    assert len({tuple(study.varied(i).items()) for i in range(24)}) == 24


def test_draws_lie_in_their_ranges_and_do_not_depend_on_how_many_there_are() -> None:
    study, fewer = study_from(RANDOM), study_from(RANDOM.replace("cells = 40", "cells = 4"))
    assert [fewer.cell(i) for i in range(4)] == [study.cell(i) for i in range(4)]
    assert study.cell(0) != study_from(RANDOM.replace("seed = 5", "seed = 6")).cell(0)
    cells = [study.varied(i) for i in range(40)]
    moduli, unit = coordinate([cell["modulus"] for cell in cells])
    numbers = [float(value) for value in moduli]
    assert unit == "kPa"
    assert all(10 <= value <= 1000 for value in numbers)
    assert 10 < sum(value < 100 for value in numbers) < 30  # half of them, by the logarithm
    assert all(0.25 <= float(cell["effects.glue_clamping.factor"]) <= 0.5 for cell in cells)
    assert {cell["model"] for cell in cells} == {"column", "beam"}


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('name = "grid"', "", "name: is missing"),
        ("loads", "load", r"load: unknown key \(did you mean 'loads'\?\)"),
        ('"1 N, 2 N"', '"10 N"', "load 10 N peak to peak takes a peak force"),
        ("sample =", "smaple =", r"axes.smaple: unknown axis 'smaple' \(did you mean 'sample'\?\)"),
        ('sample = ["1", "2"]', 'sample = ["1", "7"]', "axes.sample: unknown sample '7'"),
        ('sample = ["1", "2"]', 'design = ["singel"]', r"axes.design: unknown design 'singel' \(did you mean 'single'"),
        ('sample = ["1", "2"]', "sample = []", r"axes.sample: \[\] is no list of values"),
        ('sample = ["1", "2"]', 'sample = ["1", "1"]', "axes.sample: a value is given twice"),
        ('sample = ["1", "2"]', 'modulus = ["-1 kPa"]', "axes.modulus: '-1 kPa' is no modulus"),
        ('sample = ["1", "2"]', 'modulus = { low = "1 kPa", high = "2 kPa" }', "axes.modulus: a range is drawn from"),
        ('"1-3"', '"3-1"', "axes.seed: seeds '3-1' run backwards"),
        ('"1-3"', '"1-10000000"', f"40000000 cells of 2 loads are more than the {MOST_CELLS} cells"),
        ('"1-3"', "[-1]", "axes.seed: -1 is no seed"),
        ('low = "10 kPa"', 'low = "2000 kPa"', "does not increase"),
        ('low = "10 kPa"', 'low = "10 Pa"', "has two units"),
        ('low = "10 kPa"', 'lwo = "10 kPa"', r"lwo: unknown key \(did you mean 'low'\?\)"),
        ('low = "10 kPa"', 'low = "0 kPa"', "above 0 where its scale is 'log'"),
        ('["column", "beam"]', '{ low = "a", high = "b" }', "has no range to draw from"),
        ('name = "grid"', 'name = "g"\nhow = "fast"', "how: 'fast' is not known; valid: 'closed form' or 'bench'"),
    ],
)  # fmt: skip
def test_what_is_no_study_is_refused(old: str, new: str, complaint: str) -> None:
    base = GRID if old in GRID else RANDOM
    assert old in base
    with pytest.raises(ConfigError, match=f"(?s)^study.toml: .*{complaint}"):
        study_from(base.replace(old, new))


def test_the_example_is_a_study() -> None:
    assert len(read_study(Path(__file__).parents[1] / "examples" / "study.toml")) == 120


# --- `palpate study`: cells in closed form, on the bench, as arrays, in processes of their own; --------


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
    assert (contents(together), set(together.alone)) == (contents(alone), {""})


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
    assert (followed["x"], contents(unsure)) == (6, contents(sure))


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
