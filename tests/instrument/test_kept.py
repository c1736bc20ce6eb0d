"""Curves on disk: kept by content, checked when read, and never in the way of an answer."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import threading
import tracemalloc
from contextlib import AbstractContextManager, nullcontext
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from palpate.instrument.arithmetic import arithmetic
from palpate.instrument.errors import ConfigError
from palpate.instrument.models.axisymmetric import curves
from palpate.instrument.models.finite_elements import work
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.finite_elements.work import keep, key_of, read, write
from palpate.instrument.models.parameters import RoundParameters

CURVE = Curve(
    rates=np.array([0.0, 1e-5, 1e-4]),
    loads=np.array([[0.7], [0.5], [0.1]]),
    goals=np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]),
    offsets=np.zeros((2, 1)),
    ratio=np.array([0.2, 0.3, 0.4]),
    share=0.0,
    least=0.5,
    clamped=np.array([2.0]),
    charges=np.array([[1e-9], [2e-9], [3e-9]]),
    capacity=np.array([[1e11]]),
)


@pytest.fixture(autouse=True)
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(work.VARIABLE, str(tmp_path / "curves"))
    return tmp_path / "curves"


def refused() -> Curve:
    raise AssertionError("found although it was kept")


def bits(content: Any) -> list[tuple[str, Any]]:
    """Every number of a dataclass, to the last bit, by its name."""
    found = [(each.name, getattr(content, each.name)) for each in fields(content)]
    return [
        (name, bits(value) if is_dataclass(value) else np.asarray(value, np.float64).tobytes()) for name, value in found
    ]


def only(room: Path) -> Path:
    (file,) = room.iterdir()
    return file


# --- kept and found again ------------------------------------------------------------------------------


def test_a_curve_is_found_once_and_comes_back_bit_for_bit(room: Path) -> None:
    assert bits(keep("sensor", Curve, lambda: CURVE)) == bits(CURVE)
    back = keep("sensor", Curve, refused)
    assert bits(back) == bits(CURVE)
    assert isinstance(back.share, float)
    assert room.stat().st_mode & 0o077 == 0
    assert only(room).name == f"{key_of('sensor')}.curve"


OTHER = replace(CURVE, least=1.0)
NOW, USER = arithmetic(), os.geteuid()


@pytest.mark.parametrize(
    ("of", "name", "other"),
    [
        (work, "code_digest", "other code"),
        (os, "geteuid", USER + 1),
        *((work, "arithmetic", {**NOW, part: "another"}) for part in ("machine", "blas", "vectors", "libm")),
    ],
    ids=["code", "user", "machine", "blas", "vectors", "libm"],
)
def test_what_other_code_arithmetic_or_users_left_is_found_anew(
    of: ModuleType, name: str, other: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A script with kernels of its own must not give later commands its last digits."""
    keep("sensor", Curve, lambda: CURVE)
    monkeypatch.setattr(of, name, lambda: other)
    assert bits(keep("sensor", Curve, lambda: OTHER)) == bits(OTHER)


def test_another_sensor_is_found_anew_and_on_another_processor_of_the_same_arithmetic_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    keep("sensor", Curve, lambda: CURVE)
    assert bits(keep("other sensor", Curve, lambda: OTHER)) == bits(OTHER)
    monkeypatch.setattr(work, "arithmetic", lambda: {**NOW, "processor": "another"})
    assert bits(keep("sensor", Curve, refused)) == bits(CURVE)


def test_the_code_is_that_of_both_models_and_of_what_they_share(monkeypatch: pytest.MonkeyPatch) -> None:
    read_files: list[str] = []

    def noted(path: Path) -> bytes:
        read_files.append(path.as_posix())
        return b""

    monkeypatch.setattr(Path, "read_bytes", noted)
    work.code_digest.__wrapped__()
    for name in ("axisymmetric/mesh.py", "solid/mesh.py", "finite_elements/poles.py", "models/parameters.py"):
        assert any(file.endswith(name) for file in read_files), name


def test_the_round_sensor_is_set_up_once_for_all_objects_and_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    curves.kept_curve.cache_clear()
    first = curves.curve_on(RoundParameters(), 3, 1)
    curves.kept_curve.cache_clear()  # as in another process
    monkeypatch.setattr(curves, "found_on", lambda *_: refused())
    again = curves.curve_on(RoundParameters(sensed_modulus=5e6), 3, 1)
    assert bits(first) == bits(again)
    with pytest.raises(AssertionError, match="although it was kept"):
        curves.curve_on(RoundParameters(sensed_poisson=0.31), 3, 1)


# --- what is not to be trusted -------------------------------------------------------------------------


def _rewritten(path: Path, **changed: Any) -> bytes:
    """The file with a consistent hash and other contents, as a stranger would make it."""
    line, _, numbers = path.read_bytes().partition(b"\n")
    numbers = changed.pop("numbers", numbers)
    head = {**json.loads(line), **changed}
    del head["sha256"]
    return (
        json.dumps({**head, "sha256": hashlib.sha256(json.dumps(head).encode() + numbers).hexdigest()}).encode()
        + b"\n"
        + numbers
    )


@pytest.mark.parametrize(
    "damage",
    ["empty", "cut", "one bit", "text", "other sensor's", "not finite", "other shapes", "too many", "huge", "a name"],
)
def test_a_damaged_or_foreign_file_is_found_anew_and_replaced(
    room: Path, monkeypatch: pytest.MonkeyPatch, damage: str
) -> None:
    keep("sensor", Curve, lambda: CURVE)
    path = only(room)
    whole = path.read_bytes()
    head = json.loads(whole.partition(b"\n")[0])
    shapes = dict(head["arrays"])
    bad = {
        "empty": b"",
        "cut": whole[:-8],
        "one bit": whole[:-3] + bytes([whole[-3] ^ 1]) + whole[-2:],
        "text": b"force ratio\n",
        "other sensor's": _rewritten(path, key=key_of("other")),
        "not finite": _rewritten(path, numbers=whole.partition(b"\n")[2][:-8] + np.array([np.inf]).tobytes()),
        "other shapes": _rewritten(path, arrays={**shapes, "rates": [1], "ratio": [5]}),
        "too many": _rewritten(path, arrays={**shapes, "rates": [2]}),
        "huge": _rewritten(path, arrays={**shapes, "rates": [10**12]}),
        "a name": whole.replace(b"rates", b"ratex", 1),
    }[damage]
    path.write_bytes(bad)
    with pytest.raises(ConfigError, match="not readable"):
        read(path, Curve, key_of("sensor"))
    assert bits(keep("sensor", Curve, lambda: OTHER)) == bits(OTHER)
    assert bits(keep("sensor", Curve, refused)) == bits(OTHER)


def test_a_file_that_is_too_large_is_not_read_whole(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep("sensor", Curve, lambda: CURVE)
    monkeypatch.setattr(work, "LARGEST", 100)
    with pytest.raises(ConfigError, match="more than 100 bytes"):
        read(only(room), Curve, key_of("sensor"))


@pytest.mark.parametrize("kind", ["folder", "pipe", "link to nothing"])
def test_what_is_no_file_stops_nothing(room: Path, kind: str) -> None:
    path = room / f"{key_of('sensor')}{work.SUFFIX}"
    room.mkdir()
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)  # to open it would wait for ever
    else:
        path.symlink_to(room / "nothing")
    assert bits(keep("sensor", Curve, lambda: CURVE)) == bits(CURVE)


# --- never in the way of an answer ---------------------------------------------------------------------


def test_a_folder_that_cannot_be_made_stops_no_answer(room: Path) -> None:
    room.write_text("a file is here")
    assert bits(keep("sensor", Curve, lambda: CURVE)) == bits(CURVE)


@pytest.mark.parametrize(
    ("error", "answer"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), nullcontext()),
        (KeyboardInterrupt(), pytest.raises(KeyboardInterrupt)),
    ],
)
def test_neither_a_full_disk_nor_ctrl_c_leaves_a_half_file_and_a_full_disk_stops_no_answer(
    error: BaseException, answer: AbstractContextManager[object], room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Path, "replace", Mock(side_effect=error))
    with answer:
        assert bits(keep("sensor", Curve, lambda: CURVE)) == bits(CURVE)
    assert list(room.iterdir()) == []


def test_who_has_no_home_keeps_nothing_and_is_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv(work.VARIABLE)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    assert work.folder() is None
    assert bits(keep("sensor", Curve, lambda: CURVE)) == bits(CURVE)


@pytest.mark.parametrize(
    "platform, given, expected",
    [
        ("linux", {}, "/home/me/.cache/palpate/curves"),
        ("linux", {"XDG_CACHE_HOME": "/scratch"}, "/scratch/palpate/curves"),
        ("linux", {"XDG_CACHE_HOME": "relative"}, "/home/me/.cache/palpate/curves"),
        ("darwin", {}, "/home/me/Library/Caches/palpate/curves"),
        ("win32", {}, "/home/me/AppData/Local/palpate/curves"),
        ("linux", {"XDG_CACHE_HOME": "/scratch", "PALPATE_CURVES": "/mine"}, "/mine"),
        ("linux", {"HOME": "/home/me", "PALPATE_CURVES": "~/mine"}, "/home/me/mine"),
    ],
)
def test_curves_are_kept_among_the_users_caches(
    monkeypatch: pytest.MonkeyPatch, platform: str, given: dict[str, str], expected: str
) -> None:
    for name in (work.VARIABLE, "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(work.sys, "platform", platform)
    monkeypatch.setattr(Path, "home", lambda: Path("/home/me"))
    assert work.folder() == Path(expected)


def test_what_was_not_used_for_longest_goes_first_and_what_is_of_the_future(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for at, name in ((1e9, "used again"), (1e9 + 1, "forgotten"), (1e9 + 2, "new"), (4e9, "future")):
        keep(name, Curve, lambda: CURVE)
        path = room / f"{key_of(name)}{work.SUFFIX}"
        os.utime(path, (at, at))
    keep("used again", Curve, refused)
    monkeypatch.setattr(work, "ROOM", int(3.5 * path.stat().st_size))
    keep("one more", Curve, lambda: CURVE)
    left = {file.name.removesuffix(work.SUFFIX) for file in room.iterdir()}
    assert left == {key_of(name) for name in ("used again", "new", "one more")}


def test_readers_find_a_whole_file_while_it_is_written(room: Path) -> None:
    room.mkdir()
    path = room / "shared.curve"
    write(path, CURVE, "key")
    done = threading.Event()

    def rewrite() -> None:
        for least in range(40):
            write(path, replace(CURVE, least=float(least)), "key")
        done.set()

    writer = threading.Thread(target=rewrite)
    writer.start()
    while not done.is_set():
        assert read(path, Curve, "key").clamped == 2.0
    writer.join()


# --- a folder in which others write --------------------------------------------------------------------


def test_a_link_out_of_the_folder_is_neither_read_nor_touched(room: Path, tmp_path: Path) -> None:
    keep("sensor", Curve, lambda: CURVE)
    elsewhere = only(room).rename(tmp_path / "elsewhere.curve")
    os.utime(elsewhere, (1e9, 1e9))
    (room / f"{key_of('sensor')}{work.SUFFIX}").symlink_to(elsewhere)
    assert bits(keep("sensor", Curve, lambda: OTHER)) == bits(OTHER)
    assert bits(keep("sensor", Curve, refused)) == bits(OTHER)
    assert elsewhere.stat().st_mtime == 1e9


def test_a_head_that_is_too_long_is_not_read(room: Path) -> None:
    keep("sensor", Curve, lambda: CURVE)
    only(room).write_bytes(b"[" + b"[]," * 3_000_000 + b"[]]\n")  # as Python's lists 25 times as large
    tracemalloc.start()
    try:
        assert bits(keep("sensor", Curve, lambda: CURVE)) == bits(CURVE)
        assert tracemalloc.get_traced_memory()[1] < 5e6
    finally:
        tracemalloc.stop()


def test_files_of_others_are_never_deleted(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room.mkdir()
    others = [room / name for name in ("film.iso.part", "single.curve", "notes.txt", f"{'g' * 64}.curve")]
    for file in others:
        file.write_bytes(bytes(1000))
        os.utime(file, (0, 0))
    monkeypatch.setattr(work, "ROOM", 0)
    keep("sensor", Curve, lambda: CURVE)
    assert set(room.iterdir()) == set(others)


@pytest.mark.parametrize("kind", ["folder", "link to nothing"])
def test_what_cannot_be_deleted_does_not_let_the_folder_grow(
    room: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    for name in ("oldest", "old"):
        keep(name, Curve, lambda: CURVE)
        os.utime(room / f"{key_of(name)}{work.SUFFIX}", (1e9, 1e9))
    path = room / f"{key_of('oldest')}{work.SUFFIX}"
    size = path.stat().st_size
    path.unlink()
    path.mkdir() if kind == "folder" else path.symlink_to("nothing")
    os.utime(path, (0, 0), follow_symlinks=False)
    monkeypatch.setattr(work, "ROOM", size + 10)
    keep("new", Curve, lambda: CURVE)
    assert not (room / f"{key_of('old')}{work.SUFFIX}").exists()
    assert bits(keep("new", Curve, refused)) == bits(CURVE)


def test_what_a_killed_process_left_goes(room: Path) -> None:
    room.mkdir()
    left, being_written = (room / f"{key_of('sensor')}.{number:016x}.part" for number in range(2))
    for file in (left, being_written):
        file.write_bytes(b"half")
    os.utime(left, (1e9, 1e9))
    keep("sensor", Curve, lambda: CURVE)
    assert {file.suffix for file in room.iterdir()} == {work.SUFFIX, ".part"}
    assert being_written.exists() and not left.exists()


# --- what is worth keeping -----------------------------------------------------------------------------


def test_poles_that_cannot_matter_are_left_out() -> None:
    tiny = replace(
        CURVE,
        loads=np.array([[0.7], [1e-18], [0.1]]),
        ratio=np.array([0.2, 1e-18, 0.4]),
        charges=np.array([[1e-9], [1e-28], [3e-9]]),
    )
    short = tiny.without()
    moduli = np.geomspace(1e2, 1e12, 50)
    assert len(short.rates) == 2
    for of in (Curve.values, Curve.force_ratios, Curve.voltages, Curve.shorted):
        np.testing.assert_allclose(of(short, moduli), of(tiny, moduli), rtol=1e-15)
    for own, other in zip(short.energies(moduli), tiny.energies(moduli), strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-15)
    assert bits(CURVE.without()) == bits(CURVE)


@pytest.mark.parametrize("alone", ["loads", "ratio", "charges"])
def test_a_pole_that_matters_to_one_energy_alone_is_kept(alone: str) -> None:
    columns = {
        "loads": np.array([[0.7], [0.0], [0.1]]),
        "ratio": np.array([0.2, 0.0, 0.4]),
        "charges": np.array([[1e-9], [0.0], [3e-9]]),
    }
    columns[alone] = getattr(CURVE, alone)
    assert len(replace(CURVE, **columns).without().rates) == 3
