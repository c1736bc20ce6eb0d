"""What comes of faults, of hostile numbers, and of devices that say "later"."""

from __future__ import annotations

import itertools
import json
import multiprocessing
import os
import random
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import serial
from rich.console import Console
from rich.table import Table

from palpate.drivers.bench import Bench
from palpate.drivers.incident import INCIDENT
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.links import MULTICAST
from palpate.instrument.contracts.own import POSITIONER, SAMPLE_CHANGER, STRAIN_INDICATOR
from palpate.instrument.errors import PalpateError
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from palpate.procedures.virtual.served_bench import Wish, serving
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from palpate.simulators.planning.settle import read_scene
from tests.benchmarks.common import HEADER as RECORDED
from tests.benchmarks.common import Row, at_most, none
from tests.drivers.benches import new_form
from tests.fault_matrix import ONCE, SETTLED, STAYS, Cell, Outcome, Scenes, play_all
from tests.fault_procedures import PROCEDURES, real_bench, scene
from tests.fault_procedures import scene as usual
from tests.hostile_scenes import HOSTILE, LIMIT, STEEP, Came, Case, cases, ready, scenes, swept
from tests.moody import ACKNOWLEDGED, BUSY, HEADER, REFUSED, TAIL, Moody, Said, on_line
from tests.operations import operations, without_code_of_faults
from tests.served_kills import Blow, Client

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


FAULTS = ("failed", "with false incidents", "with orders twice or lost", "with outputs left on")


def _faults(found: Found, right: Mapping[str, int]) -> Counter[str]:
    """What is not as it should be.

    The number of moves is not compared: moods take time, by which the noise of the load cell is another one, and by
    that the number of steps down to the preload. Whether one was carried out twice is seen by itself.
    """
    orders, expected = (
        {name: count for name, count in each.items() if "with more" not in name} for each in (found["orders"], right)
    )
    wrong = found["error"], found["incidents"], found["twice"] or (orders != expected), found["left"]
    faults = Counter({fault: int(bool(each)) for fault, each in zip(FAULTS, wrong, strict=True)})
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
        for fault in FAULTS:
            yield none(f"  {fault}", faults[fault])
