"""Damages of files that are read back, and whether what reads them notices. A damage is known by its number alone.

What is compared with is independent of what is tried: the values that were written, and the bytes of each row.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from palpate.drivers.logs.bus_log import Link, Packet, PcapngWriter, read_pcapng
from palpate.instrument.calibration.files import read_calibration, write_calibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.errors import ConfigError, PalpateError, RecordError, UsageError
from palpate.procedures.records import chain
from palpate.procedures.records.chain import AROUND, HEAD_FILE, RECORD
from palpate.procedures.records.damage import check, salvaging
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.resumed import Resumed
from palpate.procedures.records.run import Run, reading
from palpate.procedures.study.run import MEASURED, BlockBuilder, Store, stored

Files = dict[str, bytes]
BAD = ("silent", "whole point not returned", "wrong point returned", "crashed")
HEADER: dict[str, Any] = {
    "procedure": "sweep-loads", "simulated": True, "started": "2026-11-22T03:04:05+00:00", "seed": 7, "settings": {},
    "scene": {"toml": ""}, "bench": "", "devices": {}, "contracts": "", "calibration": {}, "film_calibration": None,
    "versions": {},
}  # fmt: skip
POINTS = 6


@dataclass(frozen=True, slots=True)
class Victim:
    """Files in a folder, with what they were at times before, and what came of a damage of them.

    `judge(folder, files)`: what is to be counted; `files` are the damaged ones as they lie there.
    """

    files: Files
    before: list[Files]
    judge: Callable[[Path, Files], list[str]]


# --- damages --------------------------------------------------------------------------------------------


def damaged(files: Files, before: list[Files], strangers: Files, chance: random.Random) -> Files:
    """One or two files with something wrong; not a whole folder that was once so."""
    now = dict(files)
    for name in chance.sample(sorted(files), 1 if len(files) == 1 or chance.random() < 0.9 else 2):
        how = chance.random()
        if how < 0.04:
            now.pop(name)
        elif how < 0.08 and before:  # alone: a head that is taken back, and its row damaged, is as after a crash
            return files | {name: chance.choice(before)[name]}
        elif how < 0.1 and name in strangers:
            now[name] = strangers[name]
        else:
            for _ in range(1 if chance.random() < 0.8 else chance.randrange(2, 6)):
                now[name] = _hurt(now[name], chance)
    return files if now in before else now


def _hurt(content: bytes, chance: random.Random) -> bytes:
    used = len(content.rstrip(b"\0")) or len(content)
    if not content:
        return b"\0"
    at = chance.randrange(used)
    size = chance.choice((1, 8, 32, 512, 4096))
    at = at - at % size if chance.random() < 0.5 else at
    block = content[at : at + size]
    other = chance.randrange(used)
    other = other - other % size if chance.random() < 0.5 else other
    match chance.choice(("bit", "bit", "bit", "byte", "zero", "cut", "copy", "swap", "gone", "more", "noise", "end")):
        case "bit":
            return content[:at] + bytes([content[at] ^ 1 << chance.randrange(8)]) + content[at + 1 :]
        case "byte":
            return content[:at] + bytes([chance.randrange(256)]) + content[at + 1 :]
        case "zero":
            return content[:at] + bytes(len(block)) + content[at + size :]
        case "cut":
            return content[:at]
        case "copy":
            return content[:other] + block + content[other + len(block) :]
        case "swap":
            first, second = sorted((at, other))
            size = min(size, second - first, len(content) - second)
            one, two = content[first : first + size], content[second : second + size]
            return content[:first] + two + content[first + size : second] + one + content[second + size :]
        case "gone":
            return content[:at] + content[at + size :]
        case "more":
            return content[:at] + chance.randbytes(size) + content[at:]
        case "noise":
            return content[:at] + chance.randbytes(len(block)) + content[at + size :]
        case _:
            return content + chance.randbytes(size)


# --- runs -----------------------------------------------------------------------------------------------


def film(point: int, name: str) -> np.ndarray:
    wave = np.sin(np.arange(40) * 0.1 * point)
    return np.asarray(wave if name == "rigid" else -wave, np.float32)


def _write(record: Recorder, points: range) -> None:
    for n in points:
        films = {name: (250.0, film(n, name)) for name in ("rigid", "total")}
        record.point({"load_N": 0.5 * n, "force_ratio": 0.1 + n / 7}, films, 1000 * n)
        if n == 2:
            record.event("rejected", "sample 1, attempt 1: clipped", 2000)


def _read(folder: Path) -> Files:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


def killed_run(folder: Path) -> Victim:
    """A run as SIGKILL leaves it."""
    before = []
    with Recorder.create(folder, HEADER) as record:
        for n in range(1, POINTS + 1):
            before.append(_read(folder))
            _write(record, range(n, n + 1))
        files = _read(folder)
    return _run(folder, files, before)


def complete_run(folder: Path) -> Victim:
    """One that was interrupted, gone on with, and ended."""
    before = []
    with suppress(KeyboardInterrupt), Recorder.create(folder, HEADER) as record:
        _write(record, range(1, 4))
        before.append(_read(folder))
        raise KeyboardInterrupt
    before.append(_read(folder))
    with Resumed(Run.open(folder), replay=False, accept=True) as record:
        record.begin(HEADER)
        before.append(_read(folder))
        _write(record, range(4, POINTS + 1))
        before.append(_read(folder))
        record.finish("complete", {"force_ratio": 0.3})
    return _run(folder, _read(folder), before)


def _known(folder: Path) -> dict[str, Any]:
    """All that reading a run gives."""
    run = Run.open(folder)
    return {
        "header": run.header,
        "status": run.status,
        "summary": run.summary,
        "points": run.points(),
        "events": run.events(),
        "waveforms": [(w.point_id, w.name, w.rate, w.samples.tobytes()) for w in run.waveforms()],
    }


def _run(folder: Path, files: Files, before: list[Files]) -> Victim:
    for name, content in files.items():
        (folder / name).write_bytes(content)
    whole = _known(folder)
    with reading(folder) as record:
        rows: dict[int, list[bytes]] = {}
        for frame in record.frames:
            if frame.kind in (b"POIN", b"WAVE"):
                rows.setdefault(frame.id, []).append(files[RECORD][frame.at : frame.at + AROUND + frame.length])

    def judge(folder: Path, files: Files) -> list[str]:
        if not check(folder).faults:
            return ["nothing changed" if _known(folder) == whole else "silent"]
        content = files.get(RECORD, b"")
        intact = {n for n, parts in rows.items() if all(part in content for part in parts)}
        found = []
        try:
            with salvaging(folder) as left:
                right = {n for n, p in left.points.items() if _right(whole, n, p.data, left.waveforms(n))}
                if any(_wrong(whole, n, p.data, left.waveforms(n)) for n, p in left.points.items()):
                    found.append("wrong point returned")
                if intact - right:
                    found.append("whole point not returned")
        except RecordError:
            found += ["whole point not returned"] * bool(intact)
        return [*found, "noticed"]

    return Victim(files, before, judge)


def _right(whole: dict[str, Any], number: int, data: Mapping[str, Any], waveforms: Mapping[str, Any]) -> bool:
    """Whether a point with all its waveforms is as it was written."""
    return not _wrong(whole, number, data, waveforms) and len(waveforms) == 2


def _wrong(whole: dict[str, Any], number: int, data: Mapping[str, Any], waveforms: Mapping[str, Any]) -> bool:
    there = [point for point in whole["points"] if point["id"] == number]
    if not there or any(there[0][key] != value for key, value in data.items()):
        return True
    return any(
        rate != 250.0 or samples.tobytes() != film(number, name).tobytes()
        for name, (rate, samples) in waveforms.items()
    )


# --- calibrations ---------------------------------------------------------------------------------------


def load_cell_file(folder: Path) -> Victim:
    folder.mkdir()
    name = "calibration.toml"
    write_calibration(folder / name, THESIS_LOAD_CELL)

    def judge(folder: Path, files: Files) -> list[str]:
        try:
            found = read_calibration(folder / name)
        except ConfigError:
            return ["noticed"]
        return ["nothing changed" if found == THESIS_LOAD_CELL else "silent"]

    return Victim(_read(folder), [], judge)


# --- studies and bus logs ---------------------------------------------------------------------------------


def study(folder: Path) -> Victim:
    """One whose process was killed."""
    before = []
    with Store(folder, {"study": {"loads": "1 N, 2 N"}}) as store:
        for cell in range(8):
            before.append(_read(folder))
            builder = BlockBuilder(cell, 1, 1)
            builder.rows(0, [{**dict.fromkeys(MEASURED, 0.1 * cell), "valid": True, "flags": []}])
            if cell == 3:
                builder.failed(0, "too soft")
            store.add([builder.block()])
        files = _read(folder)
    for name, content in files.items():
        (folder / name).write_bytes(content)

    def held(folder: Path) -> tuple[dict[str, Any], list[bytes]]:
        asked, blocks = stored(folder)
        return asked, [block.stored() for block in blocks]

    whole = held(folder)

    def judge(folder: Path, files: Files) -> list[str]:
        try:
            return ["nothing changed" if held(folder) == whole else "silent"]
        except (RecordError, UsageError):
            return ["noticed"]

    return Victim(files, before, judge)


def bus_log(folder: Path) -> Victim:
    folder.mkdir()
    packets = [Packet(10**9 + n, "clock", Link.NOTE, True, b"%d" % n) for n in range(3)]
    packets += [Packet(10**9 + n, "sensor_node", Link.CAN, False, struct.pack("<IQ", n, n**3)) for n in range(20)]
    with (folder / "log.pcapng").open("wb") as file:
        writer = PcapngWriter(file)
        for packet in packets:
            writer.write(packet)
        writer.end()

    def judge(folder: Path, files: Files) -> list[str]:
        try:
            return ["nothing changed" if list(read_pcapng(folder / "log.pcapng")) == packets else "silent"]
        except (OSError, ValueError, struct.error):
            return ["noticed"]

    return Victim(_read(folder), [], judge)


# --- all ------------------------------------------------------------------------------------------------

VICTIMS: dict[str, Callable[[Path], Victim]] = {
    "killed run": killed_run,
    "complete run": complete_run,
    "load-cell calibration": load_cell_file,
    "study": study,
    "bus log": bus_log,
}
SHARES = {
    "killed run": 8,
    "complete run": 8,
    "load-cell calibration": 4,
    "study": 4,
    "bus log": 2,
}


@contextmanager
def damages(folder: Path) -> Iterator[Callable[[int], tuple[str, list[str]]]]:
    """What does a damage by its number: victim, and what came of it. The folder is best one in memory."""
    with patch.object(chain, "AHEAD", 20_000):  # zeros behind a run that was killed; a million take too long
        victims = {name: make(folder / name.replace(" ", "-")) for name, make in VICTIMS.items()}
    drawn = [name for name in victims for _ in range(SHARES[name])]
    strangers = complete_run(folder / "stranger").files
    strangers |= {HEAD_FILE: _stranger_head(folder / "other")}
    place = folder / "place"
    place.mkdir()

    def damage(number: int) -> tuple[str, list[str]]:
        chance = random.Random(number)
        name = chance.choice(drawn)
        victim = victims[name]
        files = damaged(victim.files, victim.before, strangers, chance)
        for path in place.iterdir():
            path.unlink()
        for file, content in files.items():
            (place / file).write_bytes(content)
        try:
            return name, victim.judge(place, files)
        except PalpateError as error:
            raise AssertionError(f"damage {number}: {error}") from error
        except Exception as error:  # a crash is what is looked for, too
            return name, ["crashed", f"crashed: {type(error).__name__}: {error}"[:200]]

    yield damage


def _stranger_head(folder: Path) -> bytes:
    with Recorder.create(folder, {**HEADER, "seed": 8}) as record:
        _write(record, range(1, 4))
        return (folder / HEAD_FILE).read_bytes()
