"""What is damaged in a run is found, and what is left of it is salvaged; both leave it as it is."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from palpate.instrument.errors import RecordError, UsageError
from palpate.procedures.records import chain
from palpate.procedures.records.chain import FRAME, ChainFile, Frame
from palpate.procedures.records.check import check
from palpate.procedures.records.encoding import row_crc32
from palpate.procedures.records.format3 import DATABASE
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.record_file import HEAD_FILE, RECORD
from palpate.procedures.records.repair import repair
from palpate.procedures.records.run import Run
from tests.procedures.conftest import HEADER, Palpate
from tests.runs import as_format3

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


def sql(*statements: str) -> Damage:
    def damage(folder: Path) -> None:
        with closing(sqlite3.connect(folder / DATABASE)) as database:
            database.create_function("row_crc32", -1, row_crc32)
            for statement in statements:
                database.execute(statement)
                if statement.startswith("UPDATE run"):
                    database.execute("UPDATE run SET crc32 = row_crc32(key, value)")
            database.commit()

    return damage


def film(n: int, name: str) -> np.ndarray:
    wave: np.ndarray = np.sin(np.arange(SAMPLES) * 0.1 * n).astype(np.float32)
    return wave if name == "rigid" else np.negative(wave)


def flip(n: int, name: str, byte: int, file: str = RECORD) -> Damage:
    """Flips a bit of a waveform of point `n`."""

    def damage(folder: Path) -> None:
        content = bytearray((folder / file).read_bytes())
        content[content.index(film(n, name).tobytes()) + byte] ^= 1
        (folder / file).write_bytes(content)

    return damage


def text_to_blob(text: str) -> Damage:
    """Flips the bit by which SQLite tells a text from a blob."""

    def damage(folder: Path) -> None:
        content = bytearray((folder / DATABASE).read_bytes())
        at = content.index(text.encode())
        content[content.rindex(13 + 2 * len(text), at - 12, at)] ^= 1
        (folder / DATABASE).write_bytes(content)

    return damage


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def near(text: bytes, *, before: int = 0, zeros: int = 1, file: str = RECORD) -> Damage:
    """Zeros, or one flipped bit, so many bytes before a text."""

    def damage(folder: Path) -> None:
        content = bytearray((folder / file).read_bytes())
        at = content.index(text) - before
        content[at : at + zeros] = bytes(zeros) if zeros > 1 else [content[at] ^ 2]
        (folder / file).write_bytes(content)

    return damage


def cut(length: int) -> Damage:
    return lambda folder: os.truncate(folder / RECORD, (folder / RECORD).stat().st_size - length)


def longer(folder: Path) -> None:
    (folder / RECORD).write_bytes((folder / RECORD).read_bytes() + b"x")


def test_a_whole_run_passes(run: Path) -> None:
    found = check(run)
    assert (found.status, found.points, found.waveforms, found.hashed, found.faults) == ("complete", 5, 10, True, [])
    as_format3(run)
    found = check(run)
    assert (found.status, found.points, found.waveforms, found.hashed, found.faults) == ("complete", 5, 10, False, [])


POINT_2 = b'{"bench_ns":2000'
DAMAGES: list[tuple[str, Damage, str, list[str]]] = [
    ("a sample", flip(2, "rigid", 50), "'rigid' of point 2 is not", ["1 of 2 waveforms of point 2, left: total"]),
    ("a point's data", near(POINT_2, before=-3), "point 2 is not as it was written", ["point 2"]),
    ("a point's length", near(POINT_2, before=36), "some of its 18 rows are", ["point 2"]),
    ("the hash before", near(POINT_2, before=9), "some of its 18 rows are", ["point 2"]),
    (
        "a waveform's number",
        near(b'{"first":0', before=60),
        "of its 18 rows",
        ["1 of 2 waveforms of point 1, left: total"],
    ),
    ("the header", near(b'{"format"', before=-9), "the header is not", ["the header", "'procedure'", "'started'"]),
    ("the magic bytes", near(b'{"format"', before=80), "its first row", ["the header", "'procedure'", "'started'"]),
    ("the event", near(b"clipped"), "event 1 is not as it was", ["event 1"]),
    ("the summary", near(b'"force_ratio"'), "the status is not as it was written", ["the status or the summary"]),
    ("a block", near(POINT_2, zeros=512), "of its 18 rows", ["point 2", "1 of 2 waveforms of point 3, left: total"]),
    ("the end", cut(1), "some of its 18 rows are", ["the status or the summary"]),
    ("the tail", cut(700), "some of its 18 rows are", ["point 5", "event 1"]),
    ("an entry of the head", near(b"\x89PAL", zeros=8, file=HEAD_FILE), "run.head is not as it was written", []),
    ("the head", lambda folder: (folder / HEAD_FILE).unlink(), "run.head: No such file", []),
    ("more than its end", longer, "goes on after its end", []),
]


@pytest.mark.parametrize(("damage", "fault", "gone"), [row[1:] for row in DAMAGES], ids=[row[0] for row in DAMAGES])
def test_damage_is_named_and_every_whole_point_is_salvaged(
    run: Path, tmp_path: Path, damage: Damage, fault: str, gone: list[str]
) -> None:
    summary = Run.open(run).summary
    damage(run)
    salvaged(run, tmp_path / "mended", fault, gone, summary)


def salvaged(run: Path, out: Path, fault: str, gone: list[str], summary: Mapping[str, object]) -> None:
    """What a check says, and what a repair brings back: every point but those that are said to be gone."""
    bytes_before = bytes_of(run)
    assert fault in " ".join(check(run).faults)
    done = repair(run, out)
    assert bytes_of(run) == bytes_before
    assert len(done.gone) == len(gone)
    assert all(part in said for part, said in zip(gone, done.gone, strict=True))
    mended = Run.open(out)
    assert check(out).faults == []
    assert mended.header["repaired"] == {"from": str(run), "hashed": done.hashed, "gone": done.gone}
    assert mended.simulated
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


DAMAGES_3: list[tuple[Damage, str, list[str]]] = [
    (flip(2, "rigid", 50, DATABASE), "'rigid' of point 2 is not", ["1 of 2 waveforms of point 2, left: total"]),
    (
        sql("UPDATE waveform SET samples = substr(samples, 1, 200) WHERE id = 10"),
        "'total' of point 5 is not",
        ["1 of 2 waveforms of point 5, left: rigid"],
    ),
    (
        sql("PRAGMA secure_delete = 1", "DELETE FROM waveform"),
        "point 1: has 0 of its 2 waveforms",
        [f"2 of 2 waveforms of point {n}, left: none" for n in range(1, 6)],
    ),
    (text_to_blob('{"load_N":1.0}'), "TEXT value in point.data", []),
    (sql("UPDATE point SET data = replace(data, '1', '2') WHERE id = 2"), "point 2 is not as it was", ["point 2"]),
    (
        sql("UPDATE waveform SET rate = 1001.0 WHERE point_id = 2 AND name = 'rigid'"),
        "'rigid' of point 2",
        ["1 of 2 waveforms of point 2, left: total"],
    ),
    (
        sql("UPDATE event SET message = 'sample 2'"),
        "event 'rejected' is not as it was written",
        ["event 1"],
    ),
    (sql("CREATE TABLE mine (x)"), "its tables are not those of a run", []),
    (sql("CREATE VIEW mine AS SELECT 1"), "it has views or triggers", []),
    (near(b"bench_ns INTEGER", file=DATABASE), "is damaged", []),
    (near(b"CREATE TABLE point", zeros=4, file=DATABASE), "is damaged", []),
    (near(b"simulated", file=DATABASE), "of the header is not as it was", ["entry 2 of the header", "'simulated'"]),
    (near(b"SQLite format", zeros=100, file=DATABASE), "file is not a database", []),
]


@pytest.mark.parametrize(("damage", "fault", "gone"), DAMAGES_3)
def test_of_format_3_every_row_that_its_checksum_vouches_for_is_salvaged(
    run: Path, tmp_path: Path, damage: Damage, fault: str, gone: list[str]
) -> None:
    summary = Run.open(run).summary
    as_format3(run)
    damage(run)
    salvaged(run, tmp_path / "mended", fault, gone, summary)


def test_a_damaged_number_of_a_point_does_not_fill_the_memory(run: Path, tmp_path: Path) -> None:
    as_format3(run)
    far = 1 << 47
    sql(f"UPDATE point SET id = {far} WHERE id = {POINTS}")(run)
    gone = repair(run, tmp_path / "mended").gone
    assert gone[0] == f"points {POINTS} to {far}"


@pytest.mark.parametrize("victim", ["database", "header of a page", "log"])
def test_of_a_killed_run_of_format_3_both_files_are_searched(run: Path, tmp_path: Path, victim: str) -> None:
    as_format3(run, killed=True)
    if victim == "database":
        (run / DATABASE).write_bytes(b"")
    path = run / f"{DATABASE}-wal"
    content = bytearray(path.read_bytes())
    if victim == "header of a page":
        content[content.rindex(b'{"load_N":2.5}') // 4120 * 4120 + 32 + 24] ^= 8
    if victim == "log":
        content[40] ^= 1  # SQLite would stop reading here
    path.write_bytes(content)
    done = repair(run, tmp_path / "mended")
    assert [point["load_N"] for point in Run.open(tmp_path / "mended").points()] == [0.5, 1.0, 1.5, 2.0, 2.5]
    assert done.waveforms == 10


def test_a_page_of_an_old_database_that_is_overwritten_costs_what_was_on_it(tmp_path: Path) -> None:
    with Recorder.create(tmp_path / "run", HEADER) as record:
        for n in range(1, 13):
            record.point({"text": "x" * 1000, "n": n}, {}, n)
        record.finish("complete", {"n": 12})
    as_format3(tmp_path / "run")
    path = tmp_path / "run" / DATABASE
    content = bytearray(path.read_bytes())
    page = content.index(b'"n":6') // 4096
    content[page * 4096 : (page + 1) * 4096] = bytes(4096)
    path.write_bytes(content)
    assert check(tmp_path / "run").faults
    done = repair(tmp_path / "run", tmp_path / "mended")
    left = [point["n"] for point in Run.open(tmp_path / "mended").points()]
    assert 6 not in left
    assert left[0] == 1
    assert left[-1] == 12
    lost = [n for n in range(1, 13) if n not in left]
    assert done.gone == [f"points {lost[0]} to {lost[-1]}" if len(lost) > 1 else f"point {lost[0]}"]
    assert 1 <= len(lost) <= 4


def test_every_flipped_byte_of_the_record_and_its_head_is_found(run: Path) -> None:
    for name in (RECORD, HEAD_FILE):
        whole = (run / name).read_bytes()
        for byte in range(0, len(whole), 61 if name == RECORD else 29):
            content = bytearray(whole)
            content[byte] ^= 1 << byte % 8
            (run / name).write_bytes(content)
            assert check(run).faults, (name, byte)
        (run / name).write_bytes(whole)
    assert check(run).faults == []


def test_where_no_row_is_whole_nothing_is_salvaged(run: Path, tmp_path: Path) -> None:
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
    tried: list[Frame] = []
    content = ChainFile.content
    monkeypatch.setattr(ChainFile, "content", lambda file, frame: tried.append(frame) or content(file, frame))
    assert check(run).faults
    assert 20 <= len(tried) <= 25


def test_a_repair_writes_into_no_run(run: Path) -> None:
    before = bytes_of(run)
    with pytest.raises(UsageError, match="already holds a run"):
        repair(run, run)
    assert bytes_of(run) == before


def test_the_commands_say_it_in_tables_and_json(palpate: Palpate, run: Path) -> None:
    assert "whole" in palpate("runs", "check", "run").out
    flip(1, "rigid", 0)(run)
    said = palpate("runs", "check", "run")
    assert said.status == 1
    assert "DAMAGED" in said.out
    assert f"palpate runs repair {run} --out DIR" in said.out
    said = palpate("runs", "check", "run", "--json")
    assert said.status == 1
    assert '"damaged": true' in said.out
    done = palpate("runs", "repair", "run", "--out", "mended", "--json").object
    assert (done["points"], done["waveforms"], len(done["gone"])) == (5, 9, 1)
    assert palpate("runs", "check", "mended", "--json").object["damaged"] is False
