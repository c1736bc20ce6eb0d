"""A study gives the same results whatever computes it and however often it was stopped; a bad cell fails alone."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.instrument.errors import BenchError, RangeError, RecordError, UsageError
from palpate.procedures.console.terminal import silent
from palpate.procedures.study.description import Value
from palpate.procedures.study.results import Results, plot_study, read_results
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


def known(results: Results) -> list[int]:
    """Cells that have an outcome."""
    return [mean.cell for mean in results.means()]


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
    assert known(whole) == list(range(12))


def test_a_cell_that_is_stored_is_not_computed_again(whole: Results, tmp_path: Path) -> None:
    def stopped(cell: Cell) -> Any:
        if cell["scene"] == "far":
            raise KeyboardInterrupt
        return evaluate(cell)

    folder = tmp_path / "stopped"
    with pytest.raises(KeyboardInterrupt) as interrupted:
        done(folder, ThreadPoolExecutor(1), evaluate=stopped)
    kept = known(read_results(folder))
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
    assert known(read_results(tmp_path / "lost")) == [0, 1, 3]
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


def test_one_process_at_a_time_works_on_a_study(tmp_path: Path) -> None:
    with Store(tmp_path, {}), pytest.raises(UsageError, match="is being worked on by another process"):
        Store(tmp_path, {})
    with Store(tmp_path, {}):
        pass


@pytest.mark.parametrize("at", ["a row", "the file"])
def test_a_damaged_study_is_told(at: str, whole: Results, tmp_path: Path) -> None:
    path = tmp_path / "whole" / RECORD
    content = path.read_bytes()
    ratio = np.float64(0.11).tobytes()
    damaged = content.replace(ratio, np.float64(0.12).tobytes(), 1) if at == "a row" else b"x" * 4096
    assert damaged != content
    path.write_bytes(damaged)
    with pytest.raises(RecordError, match=r"study\.record is damaged \(.*\); restore it from a copy"):
        read_results(tmp_path / "whole").digest()


def test_a_study_that_was_cut_off_is_told(whole: Results, tmp_path: Path) -> None:
    path = tmp_path / "whole" / RECORD
    path.write_bytes(path.read_bytes().rstrip(b"\0")[:-2000])
    with pytest.raises(
        RecordError, match=r"study\.record is damaged \(some of its .* rows are missing, .*; restore it"
    ):
        read_results(tmp_path / "whole")
    with pytest.raises(RecordError, match=r"study\.record is damaged .*, or remove its folder to begin again"):
        done(tmp_path / "whole", InTurn())


def test_a_study_whose_cells_all_fail_has_an_empty_table(tmp_path: Path) -> None:
    results = done(tmp_path, ThreadPoolExecutor(1), GRID.replace('"near", "far"', '"far"').replace('"1-3"', "[2]"))
    assert [mean.force_ratio for mean in results.means()] == [None, None]
    assert results.groups()[0].failed == 1
    for to in ("csv", "parquet"):
        assert results.export(to, tmp_path).exists()
    assert plot_study(results, tmp_path).exists()
    assert results.dataset().reason.sel(sample="1").item() == "the far scene is too far; go nearer"


def test_a_folder_without_a_study_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds no study"):
        read_results(tmp_path)


def test_a_running_study_can_be_read(whole: Results, tmp_path: Path) -> None:
    seen = []
    reader = threading.Thread(target=lambda: seen.append(read_results(tmp_path / "whole").tally().cells))
    with Store(tmp_path / "whole", {"study": whole.study.file.model_dump(mode="json")}):
        reader.start()
        reader.join()
    assert seen == [12]


def test_a_mean_is_over_the_valid_load_sets(whole: Results) -> None:
    first, _, second, *_ = whole.means()
    assert (first.valid_points, first.force_ratio, first.force_ratio_u) == (1, 0.11, 0.03)
    assert second.valid_points == 2
    assert second.force_ratio_u == pytest.approx((0.03**2 + 0.06**2) ** 0.5 / 2)


def test_a_group_holds_what_differs_in_seeds_alone(whole: Results) -> None:
    groups = whole.groups()
    assert [(group.axes["scene"], group.axes["sample"], group.cells, group.failed) for group in groups] == [
        ("near", "1", 3, 0), ("near", "2", 3, 0), ("far", "1", 3, 2), ("far", "2", 3, 2),
    ]  # fmt: skip
    assert groups[0].spread == pytest.approx(0.1)
    assert groups[2].spread is None


def test_the_dataset_of_a_grid_has_its_axes_and_the_table_its_values(whole: Results) -> None:
    found, table = whole.dataset(), whole.table()
    assert found.force_ratio.dims == ("scene", "seed", "sample", "load_N")
    assert float(found.force_ratio.sel(scene="near", seed=3, sample="2", load_N=2.0)) == 0.32
    assert found.force_ratio.sel(scene="far", seed=[2, 3]).isnull().all()
    assert str(found.reason.sel(scene="far", seed=3, sample="1").item()) == "ZeroDivisionError: a defect"
    row = table[(table.scene == "near") & (table.seed == 3) & (table["sample"] == "2") & (table.load_N == 2.0)]
    assert row.force_ratio.tolist() == [0.32]
    assert len(table) == 16
    assert table.simulated.all()


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


def test_what_cannot_be_stored_is_told(tmp_path: Path) -> None:
    (tmp_path / "taken").touch()
    with pytest.raises(RecordError, match=r"cannot write .*taken.study\.record: .*; choose a writable folder"):
        Store(tmp_path / "taken", {})
