"""What is damaged in a run is found, and what is left of it is salvaged; both leave it as it is."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from instrument.errors import RecordError, UsageError
from procedures.check import check
from procedures.encoding import row_crc32
from procedures.record import Recorder
from procedures.repair import repair
from procedures.run import DATABASE, Run
from tests.procedures.conftest import HEADER, Palpate

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


def flip(n: int, name: str, byte: int) -> Damage:
    """Flips a bit of a waveform of point `n`."""

    def damage(folder: Path) -> None:
        content = bytearray((folder / DATABASE).read_bytes())
        content[content.index(film(n, name).tobytes()) + byte] ^= 1
        (folder / DATABASE).write_bytes(content)

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


def test_a_whole_run_passes(run: Path) -> None:
    found = check(run)
    assert (found.status, found.points, found.waveforms, found.faults) == ("complete", 5, 10, [])


DAMAGES: list[tuple[Damage, str, list[str], int]] = [
    (flip(2, "rigid", 50), "'rigid' of point 2 is not", ["1 of 2 waveforms of point 2, left: total"], 5),
    (
        sql("UPDATE waveform SET samples = substr(samples, 1, 200) WHERE id = 10"),
        "'total' of point 5 is not",
        ["1 of 2 waveforms of point 5, left: rigid"],
        5,
    ),
    (
        sql("DELETE FROM waveform"),
        "point 1: has 0 of its 2 waveforms",
        [f"2 of 2 waveforms of point {n}, left: none" for n in range(1, 6)],
        5,
    ),
    (text_to_blob('{"load_N":1.0}'), "TEXT value in point.data", ["point 2"], 4),
    (sql("DELETE FROM point WHERE id = 3"), "before point 4 points are missing, from 3 on", ["point 3"], 4),
    (sql("DELETE FROM point WHERE id = 5"), "point 5 is missing, 2 waveforms of it are there", ["point 5"], 4),
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
        ["left: total"],
        5,
    ),
    (sql("UPDATE point SET bench_ns = 1 WHERE id = 4"), "bench time goes back from 3000 to 1 ns", ["point 4"], 4),
    (sql("DELETE FROM waveform WHERE id = 4"), "point 2: has 1 of its 2 waveforms", ["point 2, left: rigid"], 5),
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
            np.testing.assert_array_equal(mended.waveform(point_id, name), film(round(load / 0.5), name))
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
    whole = (run / DATABASE).read_bytes()
    for n, byte in enumerate(range(0, 4 * SAMPLES, 7)):
        flip(1 + n % POINTS, "total", byte)(run)
        assert len(check(run).faults) == 1
        (run / DATABASE).write_bytes(whole)
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


def test_an_event_that_was_changed_is_named_and_left_out(run: Path, tmp_path: Path) -> None:
    sql("UPDATE event SET message = 'sample 2'")(run)
    assert "event 'rejected' is not as it was written" in " ".join(check(run).faults)
    assert repair(run, tmp_path / "mended").gone == ["event 1"]
    assert [event["kind"] for event in Run.open(tmp_path / "mended").events()] == ["stopped"]
