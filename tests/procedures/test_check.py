"""What is damaged in a run is found, and what is left of it is salvaged; both leave it as it is."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from instrument.errors import RecordError, UsageError
from procedures.check import check
from procedures.record import Recorder
from procedures.repair import repair
from procedures.run import DATABASE, WAVEFORMS, Run, row_crc32
from tests.procedures.conftest import HEADER, Palpate

POINTS, SAMPLES = 5, 100
Damage = Callable[[Path], None]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A complete run of five points with two waveforms each."""
    with Recorder.create(tmp_path / "run", HEADER) as record:
        for n in range(1, POINTS + 1):
            film = np.sin(np.arange(SAMPLES) * 0.1 * n)
            record.point({"load_N": 0.5 * n}, {"rigid": (250.0, film), "total": (250.0, -film)}, 1000 * n)
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


def flip(name: str, byte: int) -> Damage:
    def damage(folder: Path) -> None:
        content = bytearray((folder / name).read_bytes())
        content[byte] ^= 1
        (folder / name).write_bytes(content)

    return damage


def cut(name: str, size: int) -> Damage:
    return lambda folder: os.truncate(folder / name, size)


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_whole_run_passes_and_orphan_bytes_are_no_fault_of_one_that_was_killed(run: Path) -> None:
    found = check(run)
    assert (found.status, found.points, found.waveforms, found.orphan_bytes, found.faults) == ("complete", 5, 10, 0, [])
    with (run / WAVEFORMS).open("ab") as file:
        file.write(bytes(123))
    assert check(run).faults == ["waveforms.f32: 123 bytes at the end have no row, and the run is complete"]
    sql("UPDATE run SET value = '\"running\"' WHERE key = 'status'")(run)
    assert (check(run).orphan_bytes, check(run).faults) == (123, [])


DAMAGES: list[tuple[Damage, str, list[str], int]] = [
    (flip(WAVEFORMS, 900), "'rigid' of point 2 is damaged", ["waveform 'rigid' of point 2"], 5),
    (cut(WAVEFORMS, 3999), "'total' of point 5 is cut short", ["waveform 'total' of point 5"], 5),
    (lambda folder: (folder / WAVEFORMS).unlink(), "No such file", ["No such file"] * 10, 5),
    (sql("DELETE FROM point WHERE id = 3"), "before point 4 points are missing, from 3 on", ["point 3"], 4),
    (sql("DELETE FROM point WHERE id = 5"), "waveform 'rigid': its point 5 is missing", ["point 5"], 4),
    (sql("UPDATE point SET data = '[1]' WHERE id = 2"), "point 2: its data is no JSON object", ["point 2"], 4),
    (
        sql("UPDATE OR FAIL run SET value = '{\"a\":2}' WHERE key = 'summary'"),
        "'summary' of the header is not",
        ["'summary'"],
        5,
    ),
    (sql("UPDATE point SET data = replace(data, '1', '2') WHERE id = 2"), "point 2: is not as it was", ["point 2"], 4),
    (
        sql("UPDATE waveform SET rate = 1001.0 WHERE point_id = 2 AND name = 'rigid'"),
        "'rigid' of point 2",
        ["rigid"],
        5,
    ),
    (sql("UPDATE point SET bench_ns = 1 WHERE id = 4"), "bench time goes back from 3000 to 1 ns", ["point 4"], 4),
    (sql("DELETE FROM waveform WHERE id = 4"), "point 3: begins at byte 1600, 1200 is expected", ["waveform 4"], 5),
    (sql("UPDATE run SET value = '{}' WHERE key = 'summary'"), "its summary is gone", [], 5),
    (sql("CREATE TABLE mine (x)"), "its tables are not those of a run", [], 5),
    (sql("UPDATE run SET value = '{' WHERE key = 'summary'"), "is damaged", ["'summary' of the header"], 5),
]


@pytest.mark.parametrize(("damage", "fault", "gone", "points"), DAMAGES, ids=[fault for _, fault, _, _ in DAMAGES])
def test_damage_is_named_and_the_rest_is_salvaged(
    run: Path, tmp_path: Path, damage: Damage, fault: str, gone: list[str], points: int
) -> None:
    before = Run.open(run).points()
    damage(run)
    bytes_before = bytes_of(run)
    assert fault in " ".join(check(run).faults)
    done = repair(run, tmp_path / "mended")
    assert bytes_of(run) == bytes_before
    assert len(done.gone) == len(gone)
    assert all(part in said for part, said in zip(gone, done.gone, strict=True))
    mended = Run.open(tmp_path / "mended")
    assert mended.header["repaired"] == {"from": str(run), "gone": done.gone}
    assert (mended.status, mended.summary) == ("stopped", {}) if gone else ("complete", Run.open(run).summary)
    loads = [point["load_N"] for point in mended.points()]
    assert len(loads) == points
    assert set(loads) <= {point["load_N"] for point in before}
    for point_id, load in enumerate(loads, 1):
        for name in mended.waveform_names(point_id):
            film = np.sin(np.arange(SAMPLES) * 0.1 * round(load / 0.5)).astype(np.float32)
            np.testing.assert_array_equal(mended.waveform(point_id, name), film if name == "rigid" else -film)
    assert mended.events()[0]["kind"] == "rejected"


def test_a_page_of_the_database_that_is_overwritten_costs_what_was_on_it(tmp_path: Path) -> None:
    with Recorder.create(tmp_path / "run", HEADER) as record:
        for n in range(1, 41):
            record.point({"text": "x" * 1000, "n": n}, {}, n)
        record.finish("complete", {"n": 40})
    path = tmp_path / "run" / DATABASE
    content = bytearray(path.read_bytes())
    page = content.index(b'"n":20') // 4096
    content[page * 4096 : (page + 1) * 4096] = bytes(4096)
    path.write_bytes(content)
    assert check(tmp_path / "run").faults
    done = repair(tmp_path / "run", tmp_path / "mended")
    left = [point["n"] for point in Run.open(tmp_path / "mended").points()]
    assert 20 not in left
    assert left[0] == 1
    assert left[-1] == 40
    assert done.gone == [f"point {n}" for n in range(1, 41) if n not in left]
    assert 1 <= len(done.gone) <= 4


def test_every_flipped_byte_of_the_waveforms_is_found(run: Path) -> None:
    for byte in range(0, POINTS * 2 * 4 * SAMPLES, 97):
        flip(WAVEFORMS, byte)(run)
        assert len(check(run).faults) == 1
        flip(WAVEFORMS, byte)(run)
    assert check(run).faults == []


def test_without_a_header_nothing_is_salvaged(run: Path, tmp_path: Path) -> None:
    sql("DELETE FROM run WHERE key = 'procedure'")(run)
    with pytest.raises(RecordError, match="nothing can be salvaged: the header lacks procedure"):
        repair(run, tmp_path / "mended")
    assert not (tmp_path / "mended").exists()


def test_a_repair_writes_into_no_run(run: Path) -> None:
    before = bytes_of(run)
    with pytest.raises(UsageError, match="already holds a run"):
        repair(run, run)
    assert bytes_of(run) == before


def test_the_commands_say_it_in_tables_and_json(palpate: Palpate, run: Path) -> None:
    assert "whole" in palpate("runs", "check", "run").out
    flip(WAVEFORMS, 0)(run)
    said = palpate("runs", "check", "run")
    assert said.status == 1
    assert "DAMAGED" in said.out
    assert "palpate runs repair run --out DIR" in said.out
    said = palpate("runs", "check", "run", "--json")
    assert said.status == 1
    assert '"damaged": true' in said.out
    done = palpate("runs", "repair", "run", "--out", "mended", "--json").object
    assert (done["points"], done["waveforms"], len(done["gone"])) == (5, 9, 1)
    assert palpate("runs", "check", "mended", "--json").object["damaged"] is False


def test_an_event_that_was_changed_is_named_and_left_out(run: Path, tmp_path: Path) -> None:
    sql("UPDATE event SET message = 'sample 2'")(run)
    assert "event 'rejected' is not as it was written" in " ".join(check(run).faults)
    assert repair(run, tmp_path / "mended").gone == ["event 1"]
    assert [event["kind"] for event in Run.open(tmp_path / "mended").events()] == ["stopped"]
