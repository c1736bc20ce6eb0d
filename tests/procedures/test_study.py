"""A study gives the same results whatever computes it and however often it was stopped; a bad cell fails alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.instrument.errors import BenchError, ConfigError, RangeError, RecordError, UsageError
from palpate.procedures.console.terminal import silent
from palpate.procedures.study.description import MOST_CELLS, Value, read_study
from palpate.procedures.study.results import Results, coordinate, plot_study, print_study, read_results
from palpate.procedures.study.run import RECORD, Evaluate, Store, one_by_one, run
from tests.procedures.studies import GRID, RANDOM, study_from

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
    assert done(folder, again).digest() == whole.digest()
    assert again.begun == list(range(len(kept), 12))


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
    assert found.force_ratio.dims == ("cell", "load_N")
    assert found.modulus.attrs == {"units": "kPa"}
    assert found.force_ratio.isel(load_N=0).values.tolist() == found.modulus.values.tolist()
    assert "modulus_kPa" in results.table().columns


# --- the file of a study --------------------------------------------------------------------------------


def test_a_grid_has_every_combination_and_the_last_axis_goes_fastest() -> None:
    study = study_from(GRID.replace('sample = ["1", "2"]', 'sample = "1-4"'))
    assert len(study) == 24
    assert study.cell(0) == {"scene": "near", "seed": 1, "sample": "1"}
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
