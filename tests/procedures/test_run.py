"""Reading runs: live, killed, read-only and damaged ones; the store; export."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from palpate import RecordError, UnknownName, UsageError, as_dataset
from palpate.procedures.records import chain
from palpate.procedures.records.chain import Head
from palpate.procedures.records.damage import repair
from palpate.procedures.records.export import export
from palpate.procedures.records.record import Recorder, put_file
from palpate.procedures.records.run import Run, find_run, list_runs
from tests.procedures.conftest import HEADER
from tests.runs import flip, rehash

NOBODY = 65534


def header(started: str = "2025-03-14T15:09:26Z", simulated: bool = True) -> dict[str, object]:
    return {"procedure": "sweep loads", "simulated": simulated, "started": started}


def film(point: int) -> np.ndarray:
    return np.asarray(np.sin(np.arange(100) * 0.1 * point), dtype=np.float32)


def begin(folder: Path, points: int = 2) -> Recorder:
    recorder = Recorder.create(folder, header())
    for point in range(1, points + 1):
        recorder.point({"load_N": 1.5 * point, "force_ratio": None}, {"rigid": (1000.0, film(point))}, point)
    return recorder


def finished(folder: Path, points: int = 2) -> Run:
    begin(folder, points).finish("complete", {})
    return Run.open(folder)


@contextlib.contextmanager
def as_nobody() -> Iterator[None]:
    """As root, whom permission bits do not stop, the block runs as another user."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)


def test_a_run_that_goes_on_while_it_is_read_is_not_taken_for_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = begin(tmp_path)
    read, went_on = chain.read_head, []

    def slow(path: Path) -> tuple[Head | None, str]:
        """Between head and record two points are written."""
        found = read(path)
        if not went_on:
            went_on.extend(recorder.point({"load_N": 1.5 * n}, {}, n) for n in (3, 4))
        return found

    monkeypatch.setattr(chain, "read_head", slow)
    assert len(Run.open(tmp_path).points()) == 4
    recorder.close()


def test_a_head_that_is_older_than_its_record_is_refused(tmp_path: Path) -> None:
    recorder, head = begin(tmp_path, 1), tmp_path / "run.head"
    before = head.read_bytes()
    recorder.point({"load_N": 2.0}, {}, 2)
    head.write_bytes(before)
    assert len(Run.open(tmp_path).points()) == 2  # as a kill may leave it
    recorder.point({"load_N": 2.5}, {}, 3)
    recorder.close()
    head.write_bytes(before)
    with pytest.raises(RecordError, match=r"run\.head is older than the rows that it counts"):
        Run.open(tmp_path)


def test_a_killed_run_in_a_read_only_folder_whose_name_has_marks_of_its_own_is_read(tmp_path: Path) -> None:
    recorder = begin(tmp_path / "live")
    with tempfile.TemporaryDirectory() as public:
        folder = shutil.copytree(tmp_path / "live", Path(public) / "50 % #1?mode=rw&x")  # as SIGKILL leaves it
        recorder.finish("failed", {})
        for path in (*folder.iterdir(), folder):
            path.chmod(0o555)
        Path(public).chmod(0o755)
        with as_nobody():
            assert not os.access(folder, os.W_OK, effective_ids=True)
            run = Run.open(folder)
            assert (run.status, [point["load_N"] for point in run.points()]) == ("running", [1.5, 3.0])
            np.testing.assert_array_equal(run.waveform(2, "rigid"), film(2))
        folder.chmod(0o755)


def test_a_flipped_bit_in_a_waveform_is_found_and_one_that_a_point_has_not_is_named_with_those_it_has(
    tmp_path: Path,
) -> None:
    run = finished(tmp_path)
    with pytest.raises(UnknownName, match=r"waveform of point 2 'rigd' \(did you mean 'rigid'\?\); valid: rigid"):
        run.waveform(2, "rigd")
    flip(tmp_path / "run.record", film(2).tobytes(), 100)
    assert run.waveform(1, "rigid").size == 100
    with pytest.raises(RecordError, match=r"'rigid' of point 2 is not as it was written"):
        run.waveform(2, "rigid")
    with pytest.raises(RecordError, match="point 2"):
        run.digest()


def test_a_record_that_is_cut_or_has_another_head_is_refused(tmp_path: Path) -> None:
    finished(tmp_path / "run")
    finished(tmp_path / "other", points=3)
    Recorder.create(tmp_path / "stranger", header("2025-03-14T15:09:27Z")).finish("complete", {})
    files = [tmp_path / "run" / name for name in ("run.record", "run.head")]
    record, head = (file.read_bytes() for file in files)
    for *contents, message in (
        (record[:-1], head, "some of its 6 rows are missing, changed or not in their place"),
        (record, (tmp_path / "other" / "run.head").read_bytes(), "some of its 8 rows are missing, changed"),
        (record, (tmp_path / "stranger" / "run.head").read_bytes(), "run.head belongs to another run"),
        (record, head[:-1], "run.head is not as it was written; whether the last points are there cannot be told"),
        (record, None, "run.head: No such file or directory; whether the last points are there cannot be told"),
        (b"", head, "its first row is not as it was written"),
        (None, head, "run.record: No such file"),
    ):
        for file, content in zip(files, contents, strict=True):
            file.unlink(missing_ok=True) if content is None else file.write_bytes(content)
        with pytest.raises(RecordError, match=re.escape(message)):
            Run.open(tmp_path / "run")


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
@pytest.mark.parametrize("name", ["run.record", "run.head"])
def test_what_is_no_file_is_not_waited_for(tmp_path: Path, name: str, make: Callable[[Path], None]) -> None:
    finished(tmp_path)
    (tmp_path / name).unlink()
    make(tmp_path / name)
    with pytest.raises(RecordError, match="It is no file"):
        Run.open(tmp_path)
    with pytest.raises(RecordError, match="It is no file") if name == "run.record" else contextlib.nullcontext():
        repair(tmp_path, tmp_path / "mended")


@pytest.mark.parametrize(("key", "value"), [("simulated", 1), ("started", "3"), ("procedure", None)])
def test_a_header_that_is_none_of_a_run_is_refused(tmp_path: Path, key: str, value: object) -> None:
    finished(tmp_path)
    rehash(tmp_path, header=lambda header: header.update({key: value}))
    with pytest.raises(RecordError, match="is damaged"):
        Run.open(tmp_path)


def test_a_file_beside_a_record_takes_the_place_of_a_pipe_or_a_link(tmp_path: Path) -> None:
    other, link, pipe = (tmp_path / name for name in ("other", "scene.toml", "bench.toml"))
    other.write_text("somebody's")
    link.symlink_to(other)
    os.mkfifo(pipe)
    for path in (link, pipe):
        put_file(path, "ours")
    assert [path.read_text() for path in (link, pipe, other)] == ["ours", "ours", "somebody's"]


def test_the_digest_sees_values_names_rates_and_samples(tmp_path: Path) -> None:
    one = {"rigid": (1000.0, film(1))}
    variants: list[tuple[dict[str, object], dict[str, tuple[float, np.ndarray]], int]] = [
        ({"load_N": 1.5}, one, 0),
        ({"load_N": 2.0}, one, 0),
        ({"load_N": 1.5}, {"total": one["rigid"]}, 0),
        ({"load_N": 1.5}, {"rigid": (999.0, film(1))}, 0),
        ({"load_N": 1.5}, {"rigid": (1000.0, film(2))}, 0),
        ({"load_N": 1.5}, one, 1),
        ({"load_N": 1.5}, {}, 0),
    ]
    for index, variant in enumerate(variants):
        with Recorder.create(tmp_path / str(index), header()) as recorder:
            recorder.point(*variant)
    assert len({Run.open(folder).digest() for folder in tmp_path.iterdir()}) == len(variants)


def test_runs_are_listed_newest_first_with_the_damaged_ones(tmp_path: Path) -> None:
    starts = {"b": "2025-03-14T15:00:00Z", "a": "2025-03-14T17:00:00+01:00", "c": "2024-01-01T00:00Z"}
    for name, started in starts.items():
        Recorder.create(tmp_path / name, header(started)).finish("complete", {})
    finished(tmp_path / "damaged")
    os.truncate(tmp_path / "damaged" / "run.record", 500)
    for name in ("run.record", "run.head"):
        os.utime(tmp_path / "damaged" / name, (0, 0))
    for name in ("plots", "link"):
        (tmp_path / name).mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "link" / "run.record").symlink_to("/absent/file")  # its disk is not there
    runs = list_runs(tmp_path)
    assert [(run.folder.name, run.status, run.simulated) for run in runs] == [
        ("link", "damaged", None), *((name, "complete", True) for name in "abc"), ("damaged", "damaged", None),
    ]  # fmt: skip
    assert (runs[1].points, runs[1].started.isoformat()) == (0, "2025-03-14T16:00:00+00:00")
    assert "restore" in runs[-1].fault
    assert list_runs(tmp_path / "absent") == []


def test_a_run_is_found_by_path_and_by_name(tmp_path: Path) -> None:
    folder, store = tmp_path / "store" / "20250314T150926Z-sweep", tmp_path / "store"
    finished(folder)
    assert [find_run(str(folder), tmp_path), find_run(folder.name, store)] == [folder, folder]
    with pytest.raises(UnknownName, match=r"unknown run '20250314T150926Z-swep' \(did you mean .*-sweep'\?\)"):
        find_run("20250314T150926Z-swep", store)


def test_of_very_many_names_a_message_lists_some_and_the_nearest() -> None:
    message = str(UnknownName("run", "day0500 ", (f"day{number:04}" for number in range(1000))))
    assert message.startswith("unknown run 'day0500 ' (did you mean 'day0500'?); valid: day0000, day0001, ")
    assert message.endswith(", day0059, and 940 more")


@pytest.mark.parametrize(("to", "simulated"), [("csv", True), ("parquet", False)])
def test_an_export_holds_all_values_and_its_stamp(tmp_path: Path, to: str, simulated: bool) -> None:
    with Recorder.create(tmp_path / "run", header(simulated=simulated)) as recorder:
        for point in (1, 2):
            films = {"rigid": (1000.0, film(point)), "total": (500.0, film(point + 1))}
            recorder.point({"load_N": 0.1 * point}, films, point)
    files = export(Run.open(tmp_path / "run"), to, tmp_path / "new" / "folder")
    assert [path.name for path in files] == [f"points.{to}", f"waveforms.{to}"]
    points, waveforms = (pd.read_csv(path) if to == "csv" else pd.read_parquet(path) for path in files)
    assert points["load_N"].tolist() == [0.1, 0.2]
    assert (list(waveforms.columns), len(waveforms)) == (["point", "name", "time_s", "value_V", "simulated"], 400)
    total = waveforms[(waveforms["point"] == 2) & (waveforms["name"] == "total")]
    np.testing.assert_array_equal(total["value_V"].to_numpy(np.float32), film(3))
    np.testing.assert_array_equal(total["time_s"], np.arange(100) / 500.0)
    assert [set(table["simulated"]) for table in (points, waveforms)] == [{simulated}] * 2


def test_an_export_overwrites_nothing_and_a_run_without_waveforms_exports_its_points_only(tmp_path: Path) -> None:
    run, waveforms = finished(tmp_path / "run"), tmp_path / "waveforms.csv"
    waveforms.write_text("mine")
    with pytest.raises(UsageError, match=r"waveforms\.csv exists and is not overwritten"):
        export(run, "csv", tmp_path)
    assert (waveforms.read_text(), (tmp_path / "points.csv").exists()) == ("mine", False)
    assert export(finished(tmp_path / "0", points=0), "csv", tmp_path / "0") == [tmp_path / "0" / "points.csv"]


def test_an_export_of_a_damaged_run_leaves_no_half_file(tmp_path: Path) -> None:
    run = finished(tmp_path / "run", points=4)
    flip(run.folder / "run.record", film(4).tobytes(), 100)
    with pytest.raises(RecordError, match=r"^[^ ]*run\.record is damaged \(waveform 'rigid' of point 4 is not"):
        export(run, "csv", tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_to_another_format_or_without_its_library_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    missing = r"pyarrow cannot be imported .*pip install 'palpate\[parquet\]'"
    for to, told in (("xlsx", "valid: csv, parquet"), ("parquet", missing)):
        with pytest.raises(UsageError, match=told):
            export(finished(tmp_path / to), to, tmp_path / "tables")
    assert not (tmp_path / "tables").exists()


# --- as an xarray Dataset ------------------------------------------------------------------------------


def recorded(folder: Path, rates: tuple[float, ...]) -> Run:
    """A point for each rate, the later the longer."""
    with Recorder.create(folder, HEADER) as record:
        for number, rate in enumerate(rates, 1):
            point = {
                "sample": str(number),
                "load_N": 1.5 * number,
                "force_ratio": 0.1 * number,
                "teeth": [{"tooth": 1}],
            }
            record.point(point, {"rigid": (rate, np.arange(10.0 * number))}, number)
        record.finish("complete", {})
    return Run.open(folder)


def test_points_have_sample_and_load_and_waveforms_their_time(tmp_path: Path) -> None:
    found = as_dataset(recorded(tmp_path, (250.0, 250.0)))
    second = found.set_index(point="load_N").sel(point=3.0)
    assert (second["sample"].item(), second.force_ratio.item()) == ("2", 0.2)
    assert found.time_s.values.tolist() == [index / 250 for index in range(20)]
    assert (found.rigid.attrs, second.rigid.values.tolist()) == ({"units": "V"}, list(range(20)))
    assert np.isnan(found.rigid.values[0, 10:]).all()  # it is the shorter one
    assert found.attrs["simulated"] == "true"
    assert "teeth" not in found


def test_waveforms_of_one_point_with_several_rates_have_a_time_each(tmp_path: Path) -> None:
    with Recorder.create(tmp_path, HEADER) as record:
        record.point({}, {"film": (250.0, np.arange(4.0)), "load": (10.0, np.arange(3.0))}, 1)
        record.point({}, {"film": (500.0, np.arange(4.0)), "load": (10.0, np.arange(3.0))}, 2)
    found = as_dataset(Run.open(tmp_path))
    assert "time_s" not in found.coords
    assert (found.load_time_s.values.tolist(), found.film_time_s.dims) == ([0.0, 0.1, 0.2, 0.3], ("point", "index"))
    assert found.film_time_s.values[:, 3].tolist() == [3 / 250, 3 / 500]


@pytest.mark.parametrize(
    ("value", "waveform"),
    [("x", "x"), *(pair for name in ("point", "time_s", "index") for pair in ((name, "film"), ("x", name)))],
)
def test_a_waveform_or_a_value_does_not_take_the_place_of_another(tmp_path: Path, value: str, waveform: str) -> None:
    with Recorder.create(tmp_path, HEADER) as record:
        record.point({value: 1.0, "sample": "1"}, {waveform: (250.0, np.arange(4.0))}, 1)
    name = value if waveform == "film" else waveform
    told = f"two of its values, waveforms, dimensions and times are called '{name}'; .* palpate runs export"
    with pytest.raises(UsageError, match=told):
        as_dataset(Run.open(tmp_path))


def test_a_run_without_points_is_an_empty_dataset(tmp_path: Path) -> None:
    assert as_dataset(recorded(tmp_path, ())).sizes == {"point": 0}
