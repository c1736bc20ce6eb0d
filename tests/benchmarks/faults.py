"""What comes of faults, of hostile numbers, and of devices that say "later"."""

from __future__ import annotations

import importlib
import io
import itertools
import json
import math
import multiprocessing
import os
import random
import select
import signal
import sys
import tempfile
import threading
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from copy import deepcopy
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from types import FrameType
from typing import Any, get_args
from unittest.mock import patch

import serial
import tomli_w
from pydantic.fields import FieldInfo
from rich.console import Console
from rich.table import Table

from palpate.drivers.bench import Bench
from palpate.drivers.incident import INCIDENT
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.links import MULTICAST
from palpate.instrument.contracts.own import POSITIONER, SAMPLE_CHANGER, STRAIN_INDICATOR
from palpate.instrument.errors import PalpateError
from palpate.instrument.quantity import Unit
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.virtual.served_bench import Wish, serving
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.fault import places, struck
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.heads import shipped
from palpate.simulators.scenes.scene import RigParameters, Scene, SceneFile
from tests.benchmarks.common import HEADER as RECORDED
from tests.benchmarks.common import ROOT, Row, at_most, none
from tests.drivers.benches import new_form
from tests.fault_matrix import ONCE, PROCEDURES, SETTLED, STAYS, Cell, Outcome, Scenes, play_all, real_bench, scene
from tests.fault_matrix import scene as usual
from tests.kills import Blow, Client
from tests.moody import ACKNOWLEDGED, BUSY, HEADER, REFUSED, TAIL, Moody, Said, on_line

# --- faults --------------------------------------------------------------------------------------------


def faults() -> Iterator[Row]:
    """The matrix of faults: what comes of every fault on everything that can have it, in every procedure."""
    yield _matrix("fault matrix", tuple(PROCEDURES), usual)
    yield _matrix("fault matrix of real_bench", ("sweep loads",), real_bench)
    scene = read_scene("thesis_single")
    operations(scene)  # fills what is kept between benches
    with_code = operations(scene)
    with without_code_of_faults():
        without = operations(scene)
    yield Row(
        "operations in a bench's life without faults: with their code, without it",
        f"{with_code.total()}, {without.total()}",
        "equal",
        with_code == without,
    )


def _matrix(title: str, procedures: Sequence[str], of: Scenes) -> Row:
    """Play all cells of a bench and print them; the row says how many are green."""
    outcomes = play_all(procedures, of)
    table = Table(
        title=f"{title}; r: right, m: marked, s: stopped, with the incidents in the record; fault once, then for good",
        box=None,
        padding=(0, 1, 0, 0),
    )
    for column in ("fault", "on", *(procedure.replace(" ", "\n") for procedure in procedures)):
        table.add_column(column, no_wrap="\n" in column)
    for kind, on, more in dict.fromkeys((cell.kind, cell.on, cell.more) for cell in outcomes):
        setting = f" {more[0][1]} = {more[1][1]:g}" if more else ""
        row = [[outcomes[Cell(name, kind, on, lasts, more)] for lasts in (ONCE, STAYS)] for name in procedures]
        table.add_row(kind + setting, on, *(" ".join(map(_shown, pair)) for pair in row))
    console = Console(width=160, highlight=False)
    console.print(table)
    wrong = {cell: outcome for cell, outcome in outcomes.items() if outcome.verdict == "WRONG"}
    for cell, outcome in wrong.items():
        console.print(f"WRONG: {cell.name}: {outcome.said}")
    return Row(
        f"{title}: cells right, marked or stopped with outputs at zero",
        f"{len(outcomes) - len(wrong)} of {len(outcomes)}",
        "all",
        not wrong,
    )


def _shown(outcome: Outcome) -> str:
    letter = outcome.verdict if outcome.verdict == "WRONG" else outcome.verdict[0]
    return f"{letter}{outcome.incidents or ''}"


# --- hostile scenes ------------------------------------------------------------------------------------


def hostile_scenes(most: int = 1_000_000) -> Iterator[Row]:
    """Hostile scenes: every number of every scene, effect and fault at values that no bench has.

    Each case is a sweep of one point by the command line, in a process of its own. All of them take hours; `most` are
    drawn by a seed. `$PALPATE_STEEP=1` adds powers of ten up to 1e100, and the limits of each number.
    """
    steep = bool(os.environ.get("PALPATE_STEEP"))
    listed = list(cases(HOSTILE + STEEP * steep, ends=steep))
    random.Random(35).shuffle(listed)
    with get_context("spawn").Pool(os.cpu_count(), ready) as pool:
        found = list(pool.imap_unordered(_tried, listed[:most]))
    bad = [(case, came) for case, came in found if came.bad]
    worked = sum(came.status == 0 for _, came in found)
    yield Row(f"hostile numbers in {len(scenes())} scenes", f"{len(found)}", f"{min(most, len(listed))}")
    yield Row("  that give a result, one message", f"{worked}, {len(found) - worked - len(bad)}")
    yield none("  that hang, take long, or give anything else", len(bad))
    longest = max((came.seconds for _, came in found if came.status), default=0.0)
    yield at_most("  longest until a message", longest, LIMIT, "{:.1f} s of the processor")
    for case, came in bad:
        yield Row(f"  {case} {came.bad}", " ".join(came.said[-300:].split()))


def _tried(case: Case) -> tuple[Case, Came]:
    return case, swept(case.content)


# --- moods ---------------------------------------------------------------------------------------------

MOODS = ("busy", "acknowledges", "hangs up", "late")
MIXTURES = [mixture for size in range(len(MOODS) + 1) for mixture in itertools.combinations(MOODS, size)]
BUSIEST = 4  # requests in a row that are answered "busy"
OFTEN, SELDOM = 0.3, 0.02  # probabilities; pyserial takes 0.3 s to close a port, so the line hangs up seldom
MOST_LOOKS = 4  # reads after an acknowledged write before it is carried out
LATEST = 0.02  # s of the wall
PATIENCE = 60  # s of the wall that everybody waits for an answer: a machine that is busy itself counts for nothing
WRITES = 16
ORDERS = {  # registers by which each device gets orders, by unit id on its link
    "line": {1: STRAIN_INDICATOR["command"], 2: POSITIONER["command"]},
    "sample_changer": {1: SAMPLE_CHANGER["order"]},
}
OWNED = 0x40  # register from which the amplifier's owner writes token and counter, which never come twice
SWEEP = ("sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s")


@dataclass
class Moodiness:
    """What the gateways of one bench do, and what they have let through.

    Attributes:
        mixture: the moods that they have.
        chance: what is drawn.
        orders: number of orders that were carried out, by device and value.
        done: number of moody answers, by mood.
        twice: number of moves, and of writes of the amplifier's owner, that were carried out a second time.
        owned, last: writes of the amplifier's owner; last order of each device.
    """

    mixture: tuple[str, ...]
    chance: random.Random
    orders: Counter[str] = field(default_factory=Counter)
    done: Counter[str] = field(default_factory=Counter)
    twice: int = 0
    owned: set[bytes] = field(default_factory=set)
    last: dict[tuple[str, int], bytes] = field(default_factory=dict)

    def has(self, mood: str, probability: float = OFTEN) -> bool:
        """Whether a request meets this mood."""
        met = mood in self.mixture and self.chance.random() < probability
        self.done[mood] += met
        return met

    def carried_out(self, name: str, unit: int, pdu: bytes) -> None:
        """Count a write that a device has carried out."""
        start, count = int.from_bytes(pdu[1:3]), int.from_bytes(pdu[3:5])
        order = ORDERS.get(name, {}).get(unit)
        if order is not None and start <= order.address < start + count:
            at = 6 + 2 * (order.address - start)
            value = pdu[at : at + order.size].rstrip(b"\0").hex()
            if pdu != self.last.get((name, unit)) or count == 1:
                self.orders[f"{name} {unit} {value}{' with more' if count > 1 else ''}"] += 1
            else:
                self.twice += 1  # a move to where the last one went
            self.last[name, unit] = pdu
        if name == "shaker_amplifier" and start == OWNED:
            self.twice += pdu in self.owned
            self.owned.add(pdu)


class Gateway:
    """Answers the requests of one link, moodily, from what the device answers."""

    def __init__(self, name: str, moods: Moodiness, device: Any, *, line: bool) -> None:
        """`device`: returns the reply to a frame."""
        self._name, self._moods, self._device, self._line = name, moods, device, line
        self._busy = 0
        self._due: list[bytes] = []  # writes that were acknowledged, and are yet to be carried out
        self._looks = 0  # number of reads after which they are

    def __call__(self, request: bytes) -> Said:
        moods = self._moods
        pdu = request[1:-TAIL] if self._line else request[HEADER:]
        if moods.has("late", 0.1):
            threading.Event().wait(LATEST * moods.chance.random())
        if self._busy:
            self._busy -= 1
            return Said(self._refusal(request, BUSY))
        self._looks -= 1
        if pdu[0] == WRITES or self._looks <= 0:
            while self._due:
                self._through(self._due.pop(0))
        if pdu[0] == WRITES and moods.has("acknowledges", 0.5):
            self._due, self._looks = [request], moods.chance.randint(0, MOST_LOOKS)
            if not self._looks:
                self._through(self._due.pop())
            reply = self._refusal(request, ACKNOWLEDGED)
        else:
            reply = self._through(request)
        if moods.has("busy"):
            self._busy = moods.chance.randint(1, BUSIEST)
        return Said(reply, ends=moods.has("hangs up", SELDOM if self._line else OFTEN))

    def _through(self, request: bytes) -> bytes:
        """The device's reply to a request."""
        unit, pdu = (request[0], request[1:-TAIL]) if self._line else (request[6], request[HEADER:])
        reply: bytes = self._device(request)
        if pdu[0] == WRITES and not reply[1 if self._line else HEADER] & REFUSED:
            self._moods.carried_out(self._name, unit, pdu)
        return reply

    def _refusal(self, request: bytes, code: int) -> bytes:
        if self._line:
            return on_line(request[0], bytes([request[1] | REFUSED, code]))
        return request[:4] + b"\0\3" + request[6:HEADER] + bytes([request[HEADER] | REFUSED, code])


class _Tcp:
    """The device itself on TCP."""

    def __init__(self, host: str, port: int, stack: ExitStack) -> None:
        import socket

        self._end = stack.enter_context(socket.create_connection((host, port)))

    def __call__(self, request: bytes) -> bytes:
        self._end.sendall(request)
        reply = b""
        while len(reply) < HEADER or len(reply) < 6 + int.from_bytes(reply[4:6]):
            if not (more := self._end.recv(4096)):
                raise OSError("the device is gone")
            reply += more
        return reply


class _Line:
    """The line itself."""

    def __init__(self, port: str, baudrate: int, stack: ExitStack) -> None:
        self._end = stack.enter_context(serial.Serial(port, baudrate, timeout=PATIENCE))

    def __call__(self, request: bytes) -> bytes:
        self._end.write(request)
        reply = self._end.read(5)
        while reply and on_line(reply[0], reply[1:-TAIL]) != reply:
            if not (more := self._end.read(max(1, self._end.in_waiting))):
                return b""
            reply += more
        return reply


def behind(
    description: BenchDescription, moods: Moodiness, stack: ExitStack, patience: float | None = None
) -> BenchDescription:
    """The same bench through gateways, which stand until the end of `stack`.

    `patience`: time-out of each link [s]; None: the bench's own, as a bench file with a longer one is refused.
    """
    tables = new_form(description, "")
    for name, table in tables["link"].items():
        if patience is not None:
            table["timeout"] = f"{patience} s"
        if table["kind"] == "modbus-tcp":
            device: Any = _Tcp(table["host"], table["port"], stack)
            table["port"] = stack.enter_context(Moody(Gateway(name, moods, device, line=False))).port
        elif table["kind"] == "modbus-rtu":
            device = _Line(table["port"], table["baudrate"], stack)
            peer = stack.enter_context(Moody(Gateway(name, moods, device, line=True), rtu=True))
            table["port"] = f"socket://127.0.0.1:{peer.port}"
    return BenchDescription.model_validate(tables)


Found = Mapping[str, Any]


def in_process(number: int, mixture: tuple[str, ...]) -> Found:
    """What came of one sweep in this process."""
    moods = Moodiness(mixture, random.Random(number))
    error = ""
    with tempfile.TemporaryDirectory() as folder, SimulatedBench(scene("sweep loads")) as sim, ExitStack() as stack:
        description = behind(sim.description, moods, stack, PATIENCE)
        try:
            with Recorder.create(Path(folder) / "run", RECORDED) as record:
                with Bench(description, sim.clock, sim.operator) as bench:
                    bench.attend(record.event)
                    PROCEDURES["sweep loads"](bench, record)
                record.finish("complete", {})
        except PalpateError as failure:
            error = str(failure)
        sim.clock.wait(SETTLED)
        left = max(map(abs, sim.rig.coil_voltage().extremes()))
        return _found(moods, error, Run.open(Path(folder) / "run"), left)


def served(number: int, mixture: tuple[str, ...]) -> Found:
    """What came of one sweep of another process, on a bench that this one serves, whose clock goes by its waits."""
    moods = Moodiness(mixture, random.Random(number))
    wish = Wish(scene("sweep loads"), BenchAddresses(interface=MULTICAST), None, 1.0, 1.0, (get_sample("1"),), None)
    with (
        tempfile.TemporaryDirectory() as name,
        serving(wish) as bench,
        Client(bench, Path(name)) as client,
        ExitStack() as stack,
    ):
        file, run = Path(name) / "bench.toml", Path(name) / "run"
        file.write_text(behind(bench.description, moods, stack).to_toml())
        status, _, errors = client.run(Blow(0), *SWEEP, "--bench", str(file), "--out", str(run))
        bench.sim.clock.wait(SETTLED)
        left = max(map(abs, bench.sim.rig.coil_voltage().extremes()))
        return _found(moods, errors[-500:] if status else "", Run.open(run), left)


def _found(moods: Moodiness, error: str, run: Run, left: float) -> Found:
    incidents = [event["message"] for event in run.events() if event["kind"] == INCIDENT]
    return {
        "mixture": moods.mixture, "error": error, "incidents": incidents, "orders": dict(moods.orders),
        "twice": moods.twice, "left": left, "done": dict(moods.done),
    }  # fmt: skip


MOOD_FAULTS = ("failed", "with false incidents", "with orders twice or lost", "with outputs left on")


def _faults(found: Found, right: Mapping[str, int]) -> Counter[str]:
    """What is not as it should be.

    The number of moves is not compared: moods take time, by which the noise of the load cell is another one, and by
    that the number of steps down to the preload. Whether one was carried out twice is seen by itself.
    """
    orders, expected = (
        {name: count for name, count in each.items() if "with more" not in name} for each in (found["orders"], right)
    )
    wrong = found["error"], found["incidents"], found["twice"] or (orders != expected), found["left"]
    faults = Counter({fault: int(bool(each)) for fault, each in zip(MOOD_FAULTS, wrong, strict=True)})
    if faults.total():
        print(json.dumps(found), file=sys.stderr, flush=True)  # noqa: T201
    return faults


def moods(sweeps: int = 1000, served_ones: int = 50) -> Iterator[Row]:
    """Sweeps on a bench whose devices are busy, acknowledge, hang up when nobody asks, or answer late.

    Between driver and simulated device stands a gateway on a real socket for each Modbus link; the serial line is
    reached through one that speaks RTU over TCP. What they do to a request is drawn by a seed. None of it is a fault:
    the run must have no incident, each order must have been carried out as often as on a bench without moods, and
    outputs must be off. Sweeps run in one process each, or on benches that another process serves.
    """
    workers = os.cpu_count() or 1
    for what, play, count, at_once in (
        ("in process", in_process, sweeps, workers),
        ("served", served, served_ones, 2 * workers),
    ):
        done, faults = Counter[str](), Counter[str]()
        with ProcessPoolExecutor(at_once, multiprocessing.get_context("spawn")) as pool:
            right = pool.submit(play, 0, ()).result()["orders"]
            for found in pool.map(play, range(count), [MIXTURES[each % len(MIXTURES)] for each in range(count)]):
                done += Counter(found["done"]) + Counter(sweeps=1)
                faults += _faults(found, right)
        said = ", ".join(f"{done[mood]} {mood}" for mood in MOODS)
        yield Row(f"sweeps {what} on a bench of moods", f"{done['sweeps']} ({said})", str(count))
        for fault in MOOD_FAULTS:
            yield none(f"  {fault}", faults[fault])


# --- hostile scenes, and what comes of them ----------------------------------------------------------

# A case is a sweep of one point on such a scene, by the command line, in a process of its own. It is held if it ends
# with a result, or with one message within `LIMIT` seconds.


HOSTILE = (0.0, -1.0, 1e-308, -1e-308, 1e308, -1e308, math.nan, math.inf)
STEEP = tuple(sign * 10.0**power for power in (-100, -30, -12, -6, -3, 3, 6, 12, 30, 100) for sign in (1, -1))
LIMIT = 2.0  # s of the processor until a message comes; a result may take longer
LONGEST_WAIT = 60.0  # s of the wall, after which a case counts as hanging
WRONG = ("Traceback", "Warning:", "Exception ignored", "exception was never retrieved")
TOGETHER = {"g": ("tau", ["1 s"]), "tau": ("g", [0.3])}  # keys of an effect that stand together, and a value
RIVALS = {"charge_amplifier", "voltage_amplifier"}  # effects that exclude each other
BASE = "thesis_single"
ONE_POINT = ("sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s")
Key = tuple[str | int, ...]


@dataclass(frozen=True)
class Case:
    """A scene whose number at `key` is `value`."""

    scene: str
    key: Key
    value: float
    content: Mapping[str, Any]

    def __str__(self) -> str:
        return f"{self.scene}: {'.'.join(map(str, self.key))} = {self.value!r}"


@dataclass(frozen=True)
class Came:
    """What came of a case: exit status, or None if it had to be killed; what it said; seconds of processor and wall."""

    status: int | None
    said: str
    seconds: float
    wall: float

    @property
    def bad(self) -> str:
        """What is wrong with it; empty: it is held."""
        if self.status is None:
            return "hangs"
        if self.status and self.seconds > LIMIT:
            return f"takes {self.seconds:.1f} s"
        if self.status not in (0, 1, 2) or any(each in self.said for each in WRONG):
            return "is no message"
        if self.status and self.said.count("palpate: ") != 1:
            return "is not one message"
        return ""


def scenes() -> dict[str, dict[str, Any]]:
    """The shipped scenes, and one for each effect and each fault that none of them has, by name."""
    found = {name: tomllib.loads(path.read_text()) for name, path in shipped().items()}
    base = found[BASE]
    for name in EFFECTS:
        if not any(name in each.get("effects", {}) for each in found.values()):
            others = {key: of for key, of in base["effects"].items() if not {name, key} <= RIVALS}
            found[f"with {name}"] = {**base, "effects": {**others, name: {}}}
    for kind in FAULTS:
        on = next(iter(struck(fault_class(kind).targets, places(1))))
        found[f"fault {kind}"] = {**base, "fault": [{"kind": kind, "on": on, "at": "5 s"}]}
    return found


def cases(values: tuple[float, ...] = HOSTILE, ends: bool = False) -> Iterator[Case]:
    """Every number of every scene at each of these values; `ends`: also at the ends of what it may be."""
    for name, whole in scenes().items():
        for key, info, length in _numbers(name, whole):
            for value in (*values, *(_ends(info) if ends else ())):
                written = _written(info, value)
                content = deepcopy(whole)
                _put(content, key, [written] * length if length else written)
                if key[-1] in TOGETHER:
                    other, beside = TOGETHER[str(key[-1])]
                    _put(content, (*key[:-1], other), beside)
                yield Case(name, key, value, content)


def _numbers(name: str, scene: Mapping[str, Any]) -> Iterator[tuple[Key, FieldInfo, int]]:
    """Key, declaration and (of a list) number of values of each number that a scene has or could have."""
    tables: list[tuple[Key, Any]] = []
    if "fault" in scene:
        kind = scene["fault"][0]["kind"]
        tables.append((("fault", 0), fault_class(kind)))
    elif not name.startswith("with "):
        tables += [((), SceneFile), (("rig",), RigParameters)]
    if "fault" not in scene:
        tables += [(("effects", effect), effect_class(effect)) for effect in scene.get("effects", {})]
    for key, table in tables:
        for own, info in table.model_fields.items():
            if _numeric(info.annotation):
                default = info.default
                listed = own in TOGETHER or isinstance(default, tuple)
                yield (*key, own), info, len(default or (0,)) if listed else 0


def _numeric(annotation: Any) -> bool:
    return annotation in (int, float) or any(map(_numeric, get_args(annotation)))


def _ends(info: Any) -> list[float]:
    """The least and the greatest value that a number may have, where its declaration says so."""
    found = [getattr(each, end) for each in getattr(info, "metadata", ()) for end in ("ge", "le") if hasattr(each, end)]
    annotation = getattr(info, "annotation", info)
    for inner in get_args(annotation):
        found += [*_ends(inner), *(_ends(each)[0] for each in getattr(inner, "__metadata__", ()) if _ends(each))]
    return [int(value) if annotation in (int, int | None) else float(value) for value in found]


def _unit(info: Any) -> str:
    """The unit in which a number is written; "": it is a plain number."""
    found = [each for each in getattr(info, "metadata", ()) if isinstance(each, Unit)]
    annotation = getattr(info, "annotation", info)
    inner = [*getattr(annotation, "__metadata__", ()), *getattr(annotation, "__args__", ())]
    found += [each for each in inner if isinstance(each, Unit)]
    return found[0].unit if found else next(filter(None, map(_unit, get_args(annotation))), "")


def _written(info: FieldInfo, value: float) -> Any:
    return f"{value!r} {unit}" if (unit := _unit(info)) else value


def _put(content: Any, key: Key, value: Any) -> None:
    for part in key[:-1]:
        if isinstance(content, dict):
            given = content.setdefault(part, {})
            if isinstance(given, str):  # "on" or "auto"
                content[part] = {"when": given}
        content = content[part]
    if "fault" not in key and key[-1] in ("at", "transaction", "probability"):
        raise KeyError(key)
    content[key[-1]] = value
    if isinstance(content, dict) and "kind" in content and key[-1] in ("transaction", "probability"):
        content.pop("at", None)


def ready() -> None:
    """Import what a sweep needs, so that the processes that are forked from this one need not."""
    for name in ("procedures.commands.root", "procedures.measurements.loads", "simulators.bench"):
        importlib.import_module(f"palpate.{name}")
    importlib.import_module("matplotlib.pyplot")
    swept(scenes()[BASE])


def swept(content: Mapping[str, Any]) -> Came:
    """What comes of a sweep of one point on a scene, in a forked process."""
    with tempfile.TemporaryDirectory() as folder:
        file, said = Path(folder, "scene.toml"), Path(folder, "said")
        file.write_bytes(tomli_w.dumps(dict(content)).encode())
        begun = time.monotonic()
        child = os.fork()
        if not child:
            _child(folder, said, *ONE_POINT, "--scene", str(file), "--out", str(Path(folder, "run")))
        ended = os.pidfd_open(child)
        try:
            within = bool(select.select([ended], [], [], LONGEST_WAIT)[0])
        finally:
            os.close(ended)
        if not within:
            os.kill(child, signal.SIGKILL)
        _, how, used = os.wait4(child, 0)
        status = os.waitstatus_to_exitcode(how) if within else None
        return Came(status, said.read_text(), used.ru_utime + used.ru_stime, time.monotonic() - begun)


def _child(folder: str, said: Path, *command: str) -> None:
    """Give a command in this process, and end it."""
    os.environ["PALPATE_STORE"] = folder
    out = os.open(said, os.O_CREAT | os.O_WRONLY, 0o600)
    os.dup2(out, 1)
    os.dup2(out, 2)
    sys.stdout, sys.stderr = (io.TextIOWrapper(os.fdopen(number, "wb", 0), write_through=True) for number in (1, 2))
    status = 70
    with suppress(BaseException):
        status = _main(command)
    os._exit(status)


def _main(command: tuple[str, ...]) -> int:
    import traceback

    from palpate.procedures.commands import main

    sys.argv = ["palpate", *command]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
        return 70
    return 0


# --- operations without faults -----------------------------------------------------------------------

PACKAGE = ROOT / "palpate"  # through whose links the folders are imported
OWN = tuple(f"{PACKAGE / name}/" for name in ("instrument", "drivers", "simulators", "procedures"))

# Two look at the line as often as the machine lets them, one at lock files that other programs make and remove.
NOT_COUNTED = (
    *(f"{PACKAGE}/drivers/links/modbus.py:{name}" for name in ("readable", "ReplyFramer", "RtuClient")),
    f"{PACKAGE}/simulators/wire/loop.py:Loop",
    f"{PACKAGE}/drivers/bench_lock.py:",
)


def operations(scene: Scene) -> Counter[str]:
    """Calls of each function of palpate's in the life of a scene's bench, in all threads.

    It is opened, attended, driven, read on every bus and closed.
    """
    calls = Counter[str]()

    def count(frame: FrameType, event: str, _what: object) -> None:
        file = frame.f_code.co_filename
        called = f"{file}:{frame.f_code.co_qualname}"
        if event == "call" and file.startswith(OWN) and not called.startswith(NOT_COUNTED):
            calls[called] += 1

    threading.setprofile(count)
    sys.setprofile(count)
    try:
        with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
            bench.attend(lambda *_: None)
            bench.device("signal_generator").sine(10.0, 0.1)
            carry_out(bench, "driving", bench.drive)
            carry_out(bench, "films", lambda: bench.device("sensor_node_1").acquire(0.2))
            carry_out(bench, "load", bench.device("strain_indicator").read)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return calls


@contextmanager
def without_code_of_faults() -> Iterator[None]:
    """Nothing of `palpate.simulators.faults` can be imported."""
    loaded = [name for name in sys.modules if name.startswith("palpate.simulators.faults.")]
    with patch.dict(sys.modules, dict.fromkeys(["palpate.simulators.faults", *loaded])):
        yield
