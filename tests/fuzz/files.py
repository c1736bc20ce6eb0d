"""Files that people write, those that come with palpate, and records. An input is the content of a file.

What a reader gives must be what stands in the file, key by key, and of the same type: nothing is turned into
something else silently. What is damaged in a record is either found, or leaves points and waveforms as they were.
"""

from __future__ import annotations

import atexit
import json
import math
import shutil
import tempfile
import tomllib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, is_dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.config import Config, parse
from palpate.instrument.errors import ConfigError, RecordError
from palpate.instrument.models import price_list
from palpate.instrument.models.finite_elements.work import SUFFIX, read
from palpate.instrument.models.surface import STORED, RoundMesh, SolidMesh
from palpate.procedures.records.chain import HEAD_FILE, MAGIC, RECORD
from palpate.procedures.records.damage import check, salvaging
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.heads import shipped
from tests.fuzz.target import Target, require
from tests.fuzz.values import value_of

BENCH = b"""
name = "bench"
design = "single"
force_limit = "8 N"
watchdog = "2 s"
[link.generator]
kind = "modbus-tcp"
host = "10.0.0.1"
port = 502
[device.signal_generator]
kind = "signal_generator"
link = "generator"
unit = 1
[link.amplifier]
kind = "modbus-tcp"
host = "10.0.0.2"
port = 1502
[device.shaker_amplifier]
kind = "shaker_amplifier"
link = "amplifier"
unit = 1
gain = 2.0
current_limit = "5 A"
[link.line]
kind = "modbus-rtu"
port = "/dev/ttyUSB0"
baudrate = 115200
parity = "N"
stopbits = 1
timeout = "200 ms"
[device.strain_indicator]
kind = "strain_indicator"
link = "line"
unit = 1
gage_factor = 8.98
full_scale = "200 mV"
[device.positioner]
kind = "positioner"
link = "line"
unit = 2
[link.can]
kind = "canopen"
interface = "socketcan"
channel = "can0"
bitrate = 1000000
[device.sensor_node_1]
kind = "sensor_node"
link = "can"
node = 1
[device.sensor_node_2]
kind = "sensor_node"
link = "can"
node = 2
"""
FILMS = b"""
design = "single"
covariance = [[1e-4, 0.0], [0.0, 1e-4]]
crosstalk = [[1.0]]
crosstalk_u = [[0.01]]
frequencies_Hz = [10.0]
gain = [[1.0], [1.0]]
least_N = 1.5
greatest_N = 4.0
load_cell = "thesis"
device = "20260101"
simulated = true
source = "somewhere"
created = "2026-11-21"
expires = "2027-11-21"
"""
FILM = b"""
[[films]]
name = "rigid"
sensitivity_mV_per_N = 10.0
sensitivity_u = 0.1
scatter_u = 0.1
degrees_of_freedom = 5
load_cell_u = 0.05
linearity = 0.01
clamping = 1.0
"""
WORDS = [
    b"nan", b"inf", b"-inf", b"1e400", b"9" * 5000, b"[[", b"]]", b"[" * 2000, b"a.a.a.a.", b'"', b"'''", b"\n", b"= ",
    b"true", b"-1", b"0x10", b"1979-05-27", b"\xff", b"\0", b"{ a = ", b'"1 N"', b'"auto"', b'"on"', b"null", b",",
]  # fmt: skip
FOLDER = Path(tempfile.mkdtemp(prefix="palpate-fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
atexit.register(shutil.rmtree, FOLDER, ignore_errors=True)


def in_file(name: str, data: bytes) -> Path:
    path = FOLDER / name
    path.write_bytes(data)
    return path


def holds(raw: Any, read: Any, where: str = "") -> None:
    """Whether all that stands in a file was read as it stands there."""
    if isinstance(read, Config):
        read = vars(read)
    elif is_dataclass(read):
        read = {each.name: getattr(read, each.name) for each in fields(read)}
    if isinstance(raw, dict) and isinstance(read, dict):
        for key, value in raw.items():
            require(key in read, "key", where, key)
            holds(value, read[key], f"{where}.{key}")
    elif isinstance(raw, list) and isinstance(read, (list, tuple)):
        require(len(raw) == len(read), "length", where, len(raw))
        for one, other in zip(raw, read, strict=True):
            holds(one, other, where)
    elif isinstance(raw, str) and isinstance(read, float):
        held = value_of(raw)
        require(held is None or math.isclose(float(held[0]), read, rel_tol=1e-12), "quantity", where, raw, read)
    else:
        number = type(raw) is int and type(read) is float and float(raw) == read
        require(number or (type(raw) is type(read) and raw == read), "value", where, raw, read)
        require(not isinstance(read, float) or math.isfinite(read), "finite", where, raw)


def _toml(model: type[Config], seeds: list[bytes], inner: Callable[[Any], None] = lambda _: None) -> Target:
    def decode(data: bytes) -> None:
        found = parse(data, model, "file")
        holds(tomllib.loads(data.decode()), found)
        inner(found)

    return Target(seeds, decode, WORDS)


def bench() -> Target:
    def check(found: BenchDescription) -> None:
        require(0 < found.force_limit < math.inf, "limits", found)

    return _toml(BenchDescription, [BENCH], check)


def load_cell() -> Target:
    import tomli_w

    return _toml(LoadCellCalibration, [tomli_w.dumps(THESIS_LOAD_CELL.model_dump(exclude_none=True)).encode()])


def films() -> Target:
    def check(found: FilmCalibration) -> None:
        count = len(found.films)
        square = len(found.covariance) == count and all(len(row) == count for row in found.covariance)
        gains = len(found.gain) == count and all(len(row) == len(found.frequencies_Hz) for row in found.gain)
        require(square and gains and count > 0, "shape", found)

    return _toml(FilmCalibration, [FILMS + FILM + FILM.replace(b"rigid", b"total")], check)


def scene() -> Target:
    def decode(data: bytes) -> None:
        found = read_scene(str(in_file("scene.toml", data)))
        raw = tomllib.loads(data.decode())
        holds({k: v for k, v in raw.items() if k != "fault"}, found.file)
        for name, effect in found.effects.items():
            given = raw["effects"][name]
            if isinstance(given, dict):
                holds({k: v for k, v in given.items() if k != "when"}, effect)
        require(len(found.faults) == len(raw.get("fault", [])), "faults", raw.get("fault"))

    fault = b'\n[[fault]]\nkind = "no_reply"\non = "signal_generator"\ntransaction = 3\n'
    seeds = [path.read_bytes() for path in shipped().values()]
    seeds = [seed for seed in seeds if b'"auto"' not in seed] or seeds
    return Target([*seeds, seeds[0] + fault], decode, WORDS)


def prices() -> Target:
    def decode(data: bytes) -> None:
        with patch.object(price_list, "STORED", in_file("prices.json", data)):
            found = price_list.stored.__wrapped__()
        holds(json.loads(data), found)
        count = len(found.moduli_Pa)
        lengths = {len(p.errors) for p in found.prices} | {len(p.estimates) for p in found.prices}
        require(lengths <= {count - 1}, "prices", lengths)
        require({len(r.force_ratios) for r in found.references} <= {count}, "references", count)
        require(list(found.moduli_Pa) == sorted(set(found.moduli_Pa)) and found.moduli_Pa[0] > 0, "moduli")

    return Target([price_list.STORED.read_bytes()], decode, WORDS)


def surface() -> Target:
    paths = sorted(STORED.glob(f"single*{SUFFIX}"), key=lambda path: path.stat().st_size)
    kinds = {path: RoundMesh if "round" in path.name else SolidMesh for path in paths}
    keys = {path: str(json.loads(path.read_bytes().partition(b"\n")[0])["key"]) for path in paths}
    known = {_numbers(read(path, kinds[path], keys[path])) for path in paths}

    def decode(data: bytes) -> None:
        file = in_file("a.curve", data)
        for path in paths:
            with suppress(ConfigError):
                found = _numbers(read(file, kinds[path], keys[path]))
                require(found in known, "surface", path.name)
                return
        raise ConfigError("a curve of none of them")

    return Target([path.read_bytes() for path in paths], decode, [b"NaN", b"[99999999999]", b"[-1]", b"\n", b"1e400"])


def _numbers(mesh: RoundMesh | SolidMesh) -> tuple[bytes, ...]:
    poles = mesh.poles
    return (poles.rates.tobytes(), poles.loads.tobytes(), poles.goals.tobytes(), poles.capacity.tobytes())


# --- records -------------------------------------------------------------------------------------------

HEADER = {"procedure": "sweep loads", "simulated": True, "started": datetime(2026, 11, 21, tzinfo=UTC).isoformat()}
POINTS = [({"load_N": 1.5 + n, "valid": True}, 1_000_000_000 * (n + 1)) for n in range(3)]


@cache
def _stored() -> tuple[dict[str, bytes], list[dict[str, Any]], list[dict[str, Any]], str]:
    folder = FOLDER / "good"
    with Recorder.create(folder, HEADER) as record:
        for data, bench_ns in POINTS:
            waves = {name: (1000.0, np.arange(8.0) * bench_ns) for name in ("rigid", "total")}
            record.point(data, waves, bench_ns)
        record.event("note", "a note", 4_000_000_000)
        record.finish("complete", {"points": 3})
    run = Run.open(folder)
    found = run.points(), run.events(), run.digest()
    files = {name: (folder / name).read_bytes() for name in (RECORD, HEAD_FILE)}
    return files, *found


def decode_run(data: bytes) -> None:
    files, points, events, digest = _stored()
    for name in files:
        (FOLDER / name).unlink(missing_ok=True)
    in_file(RECORD, data)
    in_file(HEAD_FILE, files[HEAD_FILE])
    faults = check(FOLDER).faults
    with suppress(RecordError), salvaging(FOLDER) as left:
        salvaged = [{"id": n, "bench_ns": point.bench_ns, **point.data} for n, point in left.points.items()]
        require(all(point in points for point in salvaged), "salvaged", salvaged)
    run = Run.open(FOLDER)
    found = run.points()
    require(run.events() == events, "events", run.events())
    require({**run.header, **run.summary} == {**HEADER, "points": 3}, "header", run.header)
    same = run.digest() == digest
    require(all(point in points for point in found), "points", found)
    require(same or bool(faults), "a run that differs and has no fault", faults)


def run() -> Target:
    return Target(
        [_stored()[0][RECORD]],
        decode_run,
        [b"\0\0", b"\xff\xff\xff\xff", b"null", b"[", MAGIC, b"WAVE", b"STAT"],
    )
