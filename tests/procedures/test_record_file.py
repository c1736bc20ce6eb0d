"""The frames of a record: what each kind holds, what a reader makes of them, and how damage is told."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.instrument.errors import RangeError
from palpate.procedures.records import record_file
from palpate.procedures.records.chain import HEAD_FILE, NOTHING, RECORD, ChainFile, Content, Head, RecordFrame, packed
from palpate.procedures.records.record_file import (
    Record,
    as_json,
    chain_of,
    event_frame,
    header_frame,
    named,
    opened,
    point_frames,
    status_frame,
    whole_waveforms,
)
from tests.procedures.conftest import HEADER
from tests.runs import flip

SAMPLES = np.array([1.5, -2.0, np.nan], dtype="<f4")


def text(frame: Content) -> bytes:
    return b"".join(map(bytes, frame[2]))


# --- what each kind holds ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frame", "kind", "content"),
    [
        (header_frame({"b": 1, "a": 2}), (b"HEAD", 0), b'{"format":4,"header":{"a":2,"b":1}}'),
        (event_frame(7, "operator", "done", 5), (b"EVNT", 7), b'{"bench_ns":5,"kind":"operator","message":"done"}'),
        (  # a file's name may hold bytes that are no UTF-8
            event_frame(1, "k", "a\udcff", 0), (b"EVNT", 1), b'{"bench_ns":0,"kind":"k","message":"a\\\\udcff"}'
        ),
        (
            status_frame("complete", {"n": 1}, {"repaired": True}), (b"STAT", 0),
            b'{"header":{"repaired":true},"status":"complete","summary":{"n":1}}',
        ),
    ],
)  # fmt: skip
def test_a_header_an_event_and_a_status_are_canonical_json(
    frame: Content, kind: tuple[bytes, int], content: bytes
) -> None:
    assert (frame[:2], text(frame)) == (kind, content)


def test_a_point_may_be_as_long_as_the_largest_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record_file, "LARGEST_ROW", 39)
    assert len(point_frames(1, {}, {}, 0)) == 1
    with pytest.raises(RangeError, match=r"^point 1 has 40 bytes, 39 are the most$"):
        point_frames(1, {}, {}, 10)


# --- values --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "json_"),
    [
        ({"b": 1, "a": [True, None]}, '{"a":[true,null],"b":1}'),
        ("µ", '"\\u00b5"'),
        (float("nan"), "null"),
        ([float("inf"), -float("inf"), 1.0], "[null,null,1.0]"),
        (np.float32(0.5), "0.5"),
        (np.int64(3), "3"),
        (np.float64("nan"), "null"),
        (np.bool_(True), "true"),
        (np.arange(3), "[0,1,2]"),
        ((1, (2, np.array([np.nan]))), "[1,[2,[null]]]"),
        ({"a": {"b": np.float64(1.5)}}, '{"a":{"b":1.5}}'),
    ],
)
def test_values_are_canonical_json_with_null_for_what_is_not_finite(value: object, json_: str) -> None:
    assert as_json(value) == json_


# --- what a reader makes of them -------------------------------------------------------------------------


def put(folder: Path, *additions: list[Content], counted: int | None = None, name: bytes | None = None) -> None:
    """The two files of a record; the head counts so many additions, all where None."""
    head = Head(chain_of(HEADER) if name is None else name, 0, 0, 0, 0, 0, NOTHING)
    content, at_end = b"", head
    for number, frames in enumerate(additions):
        kinds = [frame[0] for frame in frames]
        parts, at_end = packed(at_end, frames, 1, kinds.count(b"POIN"), kinds.count(b"EVNT"))
        content += b"".join(parts)
        if counted is None or number < counted:
            head = at_end
    folder.mkdir(exist_ok=True)
    (folder / RECORD).write_bytes(content)
    (folder / HEAD_FILE).write_bytes(b"".join(replace(head, turn=turn).packed() for turn in (2, 3)))


def rest(head: Head) -> tuple[int, int, int, int, bytes]:
    return head.frames, head.length, head.points, head.events, head.hash


def point(number: int, **data: object) -> list[Content]:
    return point_frames(number, data, {"film": (250.0, SAMPLES + number), "total": (100.0, SAMPLES)}, 10 * number)


BEGINS = [header_frame(HEADER)]


@contextmanager
def record(folder: Path, *additions: list[Content], **given: Any) -> Iterator[Record]:
    put(folder, *additions, **given)
    with opened(folder) as found:
        yield found


def test_frames_of_other_kinds_are_ignored_but_must_be_whole(tmp_path: Path) -> None:
    with record(tmp_path, BEGINS, [(b"NEWS", 0, [b"{}"])]) as found:
        assert found.count() == 0
    flip(tmp_path / RECORD, b"{}")
    with pytest.raises(ValueError, match=r"^row 1 is not as it was written$"), opened(tmp_path):
        pass


@pytest.mark.parametrize(
    ("additions", "given", "says"),
    [
        ([[event_frame(1, "k", "m", 0)]], {}, "KeyError|format"),
        ([[(b"HEAD", 0, [b'{"format":5,"header":{}}'])]], {}, "its record format is not 4"),
        ([[(b"BODY", 0, [b'{"format":4,"header":{}}'])]], {}, "its record format is not 4"),
        ([BEGINS], {"name": b"x" * 16}, "its header belongs to other rows"),
        ([BEGINS, [(b"POIN", 1, [b"{}"]), (b"POIN", 1, [b"{}"])]], {}, "some of its 2 points and 0 events are missing"),
    ],
)
def test_a_record_that_does_not_hang_together_is_refused(
    additions: list[list[Content]], given: dict[str, Any], says: str, tmp_path: Path
) -> None:
    with pytest.raises((ValueError, KeyError), match=says), record(tmp_path, *additions, **given):
        pass


@pytest.mark.parametrize(
    ("frame", "says"),
    [
        (BEGINS[0], "the header"),
        ((b"WAVE", 3, []), "a waveform of point 3"),
        ((b"POIN", 3, []), "point 3"),
        ((b"EVNT", 3, []), "event 3"),
        ((b"STAT", 0, []), "the status"),
        ((b"NEWS", 3, []), "row 8"),
    ],
)
def test_a_frame_is_called_by_what_it_holds(frame: Content, says: str) -> None:
    assert named(RecordFrame(b"", 8, frame[0], frame[1], 0, 0, b"", b"", 0)) == says


# --- what a killed writer leaves -------------------------------------------------------------------------


def test_what_lies_behind_the_head_is_confirmed_up_to_the_last_whole_addition(tmp_path: Path) -> None:
    with record(tmp_path, BEGINS, point(1), point(2), counted=2) as found:
        content = (tmp_path / RECORD).read_bytes()
        assert rest(found.head_at_end()) == (7, len(content), 2, 0, found.frames[-1].hash)
        assert found.tail() == content[found.head.length :]


def test_waveforms_without_their_point_are_not_confirmed_and_damage_in_them_is_a_fault(tmp_path: Path) -> None:
    with record(tmp_path, BEGINS, point(1), point(2)[:1], counted=2) as found:
        assert (found.tail(), rest(found.head_at_end()), list(found.faults())) == (b"", rest(found.head), [])
    put(tmp_path, BEGINS, point(1)[:1])  # which the head counts: they were written by a repair
    flip(tmp_path / RECORD, b'"rate":250.0}\n', 20)
    with opened(tmp_path) as found:
        assert found.head_at_end().frames == 2
        assert list(found.faults()) == ["a waveform of point 1 is not as it was written"]


@pytest.mark.parametrize(
    ("status", "faults"), [("complete", ["run.record goes on after its end, from byte {} on"]), ("stopped", [])]
)
def test_a_finished_run_goes_on_with_nothing_but_zeros(status: str, faults: list[str], tmp_path: Path) -> None:
    put(tmp_path, BEGINS, [status_frame(status, {})])
    content = (tmp_path / RECORD).read_bytes()
    for behind, told in ((bytes(9), []), (bytes(9) + b"x", faults)):
        (tmp_path / RECORD).write_bytes(content + behind)
        with opened(tmp_path) as found:
            assert list(found.faults()) == [fault.format(len(content)) for fault in told]


# --- waveforms in pieces -------------------------------------------------------------------------------

Pieces = list[tuple[int, str, float, list[float]]]


@pytest.mark.parametrize(
    ("pieces", "found"),
    [
        ([(0, "film", 250.0, [1.0, 2.0, 3.0])], [1.0, 2.0, 3.0]),
        ([(2, "film", 250.0, [3.0]), (0, "film", 250.0, [1.0, 2.0])], [1.0, 2.0, 3.0]),  # in another order
        ([(0, "film", 250.0, [1.0, 2.0]), (0, "film", 250.0, [1.0, 2.0]), (2, "film", 250.0, [3.0])], [1.0, 2.0, 3.0]),
        ([(0, "film", 250.0, [1.0, 2.0])], None),
        ([(1, "film", 250.0, [2.0, 3.0])], None),
        ([(0, "film", 250.0, [1.0]), (2, "film", 250.0, [3.0])], None),  # a gap
        ([(0, "film", 100.0, [1.0, 2.0, 3.0])], None),  # of another rate
        ([(0, "total", 250.0, [1.0, 2.0, 3.0])], None),
        ([(0, "film", 250.0, [1.0, 2.0, 3.0, 4.0])], None),
        ([], None),
    ],
)
def test_a_waveform_is_whole_where_its_pieces_join(pieces: Pieces, found: list[float] | None, tmp_path: Path) -> None:
    waves: list[Content] = [
        (
            b"WAVE", 1,
            [as_json({"first": first, "name": name, "rate": rate}).encode() + b"\n", np.array(values, "<f4").tobytes()],
        )
        for first, name, rate, values in pieces
    ]  # fmt: skip
    put(tmp_path, BEGINS, waves)
    with ChainFile(tmp_path / RECORD) as file:
        whole = whole_waveforms(file, list(file.walk(None))[1:], [["film", 250.0, 3]])
    assert {name: samples.tolist() for name, samples in whole.items()} == ({} if found is None else {"film": found})


def test_a_point_whose_waveform_is_not_whole_is_told_when_it_is_read(tmp_path: Path) -> None:
    _, *others = point(1)
    with record(tmp_path, BEGINS, others) as found:
        with pytest.raises(ValueError, match=r"^waveform 'film' of point 1 is not as it was written$"):
            list(found.waveforms(1))
        assert found.count() == 1
