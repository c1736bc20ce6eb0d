"""What is damaged, cut off, torn or never written is told, and what is left is salvaged; both leave a run as it is."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from palpate.instrument.errors import RecordError, UsageError
from palpate.procedures.records import chain
from palpate.procedures.records.chain import FRAME, HEAD_FILE, MOST_HOLES, RECORD, ChainFile, RecordFrame, check_holes
from palpate.procedures.records.damage import check, repair
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run, list_runs
from palpate.procedures.study.results import read_results
from tests.benchmarks.records import cuts, failing
from tests.damages import BAD, VICTIMS, damages
from tests.procedures.conftest import HEADER, Palpate
from tests.runs import flip

POINTS, SAMPLES = 5, 100
Damage = Callable[[Path], None]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A complete run of five points with two waveforms each."""
    with Recorder.create(tmp_path / "run", HEADER) as record:
        for n in range(1, POINTS + 1):
            films = {name: (250.0, film(n, name)) for name in ("rigid", "total")}
            record.point({"load_N": 0.5 * n}, films, 1000 * n)
        record.event("rejected", "sample 1, attempt 1: clipped", 2500)
        record.finish("complete", {"force_ratio": 0.3})
    return tmp_path / "run"


def film(n: int, name: str) -> np.ndarray:
    wave: np.ndarray = np.sin(np.arange(SAMPLES) * 0.1 * n).astype(np.float32)
    return wave if name == "rigid" else np.negative(wave)


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def near(text: bytes, beside: int = 0) -> Damage:
    """Flips a bit near a text."""
    return lambda folder: flip(folder / RECORD, text, beside)


def zeros(text: bytes, count: int, file: str = RECORD) -> Damage:
    """Zeros from a text on."""

    def damage(folder: Path) -> None:
        content = bytearray((folder / file).read_bytes())
        at = content.index(text)
        content[at : at + count] = bytes(count)
        (folder / file).write_bytes(content)

    return damage


POINT_2 = b'{"bench_ns":2000'
DAMAGES: list[tuple[str, Damage, str, list[str]]] = [
    (
        "a sample",
        near(film(2, "rigid").tobytes(), 50),
        "'rigid' of point 2 is not",
        ["waveform rigid of point 2, left: total"],
    ),
    ("a point's data", near(POINT_2, 3), "point 2 is not as it was written", ["point 2"]),
    ("a point's length", near(POINT_2, -36), "some of its 18 rows are", ["point 2"]),
    ("the hash before", near(POINT_2, -9), "some of its 18 rows are", ["point 2"]),
    (
        "a waveform's number",
        near(b'{"first":0', -60),
        "of its 18 rows",
        ["waveform rigid of point 1, left: total"],
    ),
    ("the header", near(b'{"format"', 9), "the header is not", ["the header", "'procedure'", "'started'"]),
    ("the magic bytes", near(b'{"format"', -80), "its first row", ["the header", "'procedure'", "'started'"]),
    ("the event", near(b"clipped"), "event 1 is not as it was", ["event 1"]),
    ("the summary", near(b'"force_ratio"'), "the status is not as it was written", ["the status or the summary"]),
    ("a block", zeros(POINT_2, 512), "of its 18 rows", ["point 2", "waveform rigid of point 3, left: total"]),
    (
        "the end",
        lambda folder: os.truncate(folder / RECORD, (folder / RECORD).stat().st_size - 1),
        "some of its 18 rows are",
        ["the status or the summary"],
    ),
    (
        "the tail",
        lambda folder: os.truncate(folder / RECORD, (folder / RECORD).stat().st_size - 700),
        "some of its 18 rows are",
        ["point 5", "event 1"],
    ),
    ("an entry of the head", zeros(b"\x89PAL", 8, HEAD_FILE), "run.head is not as it was written", []),
    ("the head", lambda folder: (folder / HEAD_FILE).unlink(), "run.head: No such file", []),
    (
        "more than its end",
        lambda folder: (folder / RECORD).write_bytes((folder / RECORD).read_bytes() + b"x"),
        "goes on after its end",
        [],
    ),
]


@pytest.mark.parametrize(("damage", "fault", "gone"), [row[1:] for row in DAMAGES], ids=[row[0] for row in DAMAGES])
def test_damage_is_named_and_every_whole_point_is_salvaged(
    run: Path, tmp_path: Path, damage: Damage, fault: str, gone: list[str]
) -> None:
    """A check says it, and a repair brings back every point but those that are said to be gone."""
    summary, out = Run.open(run).summary, tmp_path / "mended"
    damage(run)
    bytes_before = bytes_of(run)
    found, done = check(run), repair(run, out)
    assert fault in " ".join(found.faults)
    assert (found.points, found.waveforms, bytes_of(run)) == (done.points, done.waveforms, bytes_before)
    assert all(part in said for part, said in zip(gone, done.gone, strict=True))
    mended = Run.open(out)
    assert (check(out).faults, mended.simulated) == ([], True)
    assert mended.header["repaired"] == {"from": str(run), "gone": done.gone}
    assert (mended.status, mended.summary) == (("stopped", {}) if gone else ("complete", summary))
    loads = [point["load_N"] for point in mended.points()]
    assert loads == [0.5 * n for n in range(1, POINTS + 1) if f"point {n}" not in done.gone]
    for point_id, load in enumerate(loads, 1):
        n = round(load / 0.5)
        names = mended.waveform_names(point_id)
        assert names == ["rigid", "total"] or any(f"of point {n}, left: {', '.join(names)}" in said for said in gone)
        for name in names:
            np.testing.assert_array_equal(mended.waveform(point_id, name), film(n, name))
    assert mended.events()[0]["kind"] == "rejected" or "event 1" in done.gone


@pytest.mark.parametrize(("name", "step"), [(RECORD, 61), (HEAD_FILE, 29)])
def test_every_flipped_byte_of_the_record_and_its_head_is_found(run: Path, name: str, step: int) -> None:
    whole = (run / name).read_bytes()
    for byte in range(0, len(whole), step):
        content = bytearray(whole)
        content[byte] ^= 1 << byte % 8
        (run / name).write_bytes(content)
        assert check(run).faults, byte


def test_a_repair_writes_into_no_run_and_where_no_row_is_whole_nothing_is_salvaged(run: Path, tmp_path: Path) -> None:
    before = bytes_of(run)
    with pytest.raises(UsageError, match="already holds a run"):
        repair(run, run)
    assert bytes_of(run) == before
    (run / RECORD).write_bytes(b"x" * 5000)
    with pytest.raises(RecordError, match=r"nothing can be salvaged: .* has no whole row"):
        repair(run, tmp_path / "mended")
    assert not (tmp_path / "mended").exists()


def test_a_forged_record_cannot_keep_a_repair_for_ever(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start = (run / RECORD).read_bytes()[: FRAME.size]
    fields = list(FRAME.unpack(start))
    fields[6] = 50_000  # each says to be as long
    (run / RECORD).write_bytes(FRAME.pack(*fields) * 2000)
    monkeypatch.setattr(chain, "MOST_IN_VAIN", 1_000_000)
    tried: list[RecordFrame] = []
    content = ChainFile.content
    monkeypatch.setattr(ChainFile, "content", lambda file, frame: tried.append(frame) or content(file, frame))
    assert check(run).faults
    assert 20 <= len(tried) <= 25


def test_the_commands_say_it_in_tables_and_json(palpate: Palpate, run: Path) -> None:
    assert "whole" in palpate("runs", "check", "run").out
    flip(run / RECORD, film(1, "rigid").tobytes())
    said, of_json = palpate("runs", "check", "run"), palpate("runs", "check", "run", "--json")
    assert (said.status, of_json.status) == (1, 1)
    assert "DAMAGED" in said.out and f"palpate runs repair {run} --out DIR" in said.out
    assert '"damaged": true' in of_json.out
    done = palpate("runs", "repair", "run", "--out", "mended", "--json").object
    assert (done["points"], done["waveforms"], len(done["gone"])) == (5, 9, 1)
    assert palpate("runs", "check", "mended", "--json").object["damaged"] is False


# --- files that are longer than what was ever written --------------------------------------------------


SPARSE = 200_000_000_000  # bytes


@pytest.fixture
def short(tmp_path: Path) -> Path:
    with Recorder.create(tmp_path / "run", HEADER) as record:
        record.point({"load_N": 2.0}, {}, 5)
        record.finish("complete", {"samples": []})
    return tmp_path / "run"


def test_a_sparse_file_of_a_run_is_refused_with_its_size_and_what_to_do(short: Path, tmp_path: Path) -> None:
    whole = (short / RECORD).stat().st_size
    os.truncate(short / RECORD, SPARSE)
    said = rf"{RECORD} is damaged \(it is {SPARSE} bytes long, and more than {MOST_HOLES} of them were never written"
    for read in (Run.open, lambda short: repair(short, tmp_path / "mended")):
        with pytest.raises(RecordError, match=said):
            read(short)
    (listed,) = list_runs(tmp_path)
    assert listed.status == "damaged"
    assert all("never written" in fault for fault in (check(short).faults[0], listed.fault))
    os.truncate(short / RECORD, whole)
    assert check(short).faults == []


@pytest.mark.parametrize("command", ["show", "replay"])
def test_so_is_a_bus_log_from_the_command_line(palpate: Palpate, command: str) -> None:
    sparse(Path("trace.pcapng"))
    said = palpate("bus", command, "trace.pcapng").complaint
    assert said.startswith(f"trace.pcapng is damaged (it is {SPARSE} bytes long")


def sparse(file: Path) -> None:
    file.touch()
    os.truncate(file, SPARSE)


def test_so_is_a_study(tmp_path: Path) -> None:
    sparse(tmp_path / "study.record")
    with pytest.raises(RecordError, match="never written"):
        read_results(tmp_path)


def test_too_little_memory_is_one_message(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.procedures.logs.read_log", Mock(side_effect=MemoryError))
    Path("trace.pcapng").touch()
    said = palpate("bus", "show", "trace.pcapng").complaint
    assert said.startswith("this computer has too little memory")


def test_holes_between_data_count_together_and_what_was_written_counts_for_none(tmp_path: Path) -> None:
    with (tmp_path / "file").open("wb") as file:
        for part in range(4):
            file.seek(part * MOST_HOLES // 2 + part * 4096)
            file.write(bytes(4096))
    with pytest.raises(RecordError):
        check_holes(tmp_path / "file")
    os.truncate(tmp_path / "file", MOST_HOLES // 2 + 4096)
    check_holes(tmp_path / "file")
    shutil.rmtree(tmp_path)
    check_holes(tmp_path / "file")


# --- a share of the campaign of damages ----------------------------------------------------------------


@pytest.mark.parametrize(
    "share", [range(60), pytest.param(range(60, 1000), marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_no_damage_is_silent_and_every_whole_point_is_returned(tmp_path: Path, share: range) -> None:
    found, bad = Counter[str](), []
    with damages(tmp_path) as damage:
        for number in share:
            victim, came = damage(number)
            found[victim] += 1
            bad += [(number, victim, came)] * any(what in BAD for what in came)
    assert (bad, found.keys()) == ([], VICTIMS.keys())


# --- writes and syncs that fail, tear or are dropped ---------------------------------------------------


@pytest.fixture
def two_points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setattr(chain, "AHEAD", 2000)  # a million zeros take their time in each case
    with Recorder.create(tmp_path / "run", HEADER) as record:
        for n in (1, 2):
            record.point({"load_N": 0.5 * n}, {"rigid": (250.0, np.sin(0.1 * n * np.arange(300)))}, n)
        record.finish("complete", {"points": 2})
    return Run.open(tmp_path / "run")


def test_an_operation_that_fails_costs_no_acknowledged_point(two_points: Run, tmp_path: Path) -> None:
    assert set(failing(two_points, tmp_path)) == {"kept"}


def test_a_power_cut_costs_no_acknowledged_point(two_points: Run, tmp_path: Path) -> None:
    assert set(cuts(two_points, tmp_path, 1, lying=False)) == {"kept"}


@pytest.mark.slow
def test_what_a_disk_that_drops_a_sync_loses_is_told(two_points: Run, tmp_path: Path) -> None:
    found = cuts(two_points, tmp_path, 0, lying=True)
    assert found["lost and told"]
    assert not found["silent"]
