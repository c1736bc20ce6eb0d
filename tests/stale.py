"""Replies that come twice, the second time late: what a driver makes of them, on wires of pure arithmetic.

Each try asks a few times, and one of the answers is repeated up to two time-outs later, half of the time aimed at the
moment when a later answer is due. `Counter` names: of each kind the tries, the repetitions that could be taken for the
answer that was due, and what was taken.
"""

from __future__ import annotations

import queue
import random
import struct
from collections import Counter
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import canopen

from palpate.drivers.devices.load_indicator import StrainIndicator
from palpate.drivers.devices.positioner import MicroPositioner
from palpate.drivers.links.can import CheckedSdoClient
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.contracts.own import POSITIONER, STRAIN_INDICATOR, shortest_transfer
from palpate.instrument.errors import BenchError
from tests.drivers.virtual_line import VirtualLine, checked

UNIT, BAUDRATE, BITRATE, TIMEOUT = 2, 115200, 1e6, 1.0
SLOWEST, AIM = 5e-3, 8e-3  # s: a device takes so long at most; a repetition is aimed at so much before it
DISPLAY, LIMIT = STRAIN_INDICATOR["status"].address, POSITIONER["limit_low"].address
POSITION = POSITIONER["position"].address
RENEWALS = 10  # of a display, a second
UNLIKE = 3  # reads, after which a poll is asked for in the same number of registers again
ROUND = 20_000  # of the number that a position tells
READ, WRITE = 3, 16
NONE = ("lengths differ: stale", "polls: stale", "counter: stale", "other object: stale")  # of these there may be none
TOLD = (
    "lengths alike: stale",
    "same object: stale",
    "segments: wrong",
    "polls alike: stale",
    "writes alike: wrongly confirmed",
)


class Line:
    """A serial line whose devices tell when they were asked, and repeat an answer that is chosen."""

    def __init__(self, chance: random.Random) -> None:
        self.chance = chance
        self.line = VirtualLine(self._answers, BAUDRATE, TIMEOUT)
        self.link = ModbusLink("virtual line", self.line)
        self.asked = 0
        self.deaf = self.repeat = False
        self.moves = False  # its position tells, too
        self.due = 0.0  # when the repetition comes

    def _answers(self, request: bytes) -> list[tuple[float, bytes]]:
        self.asked += 1
        address, count = struct.unpack(">HH", request[2:6])
        if request[1] == WRITE:
            answer = checked(request[:6])
        else:
            answer = checked(bytes([UNIT, READ, 2 * count]) + self._registers(address, count))
        takes = self.chance.uniform(0, SLOWEST)
        if self.deaf:
            return []
        if self.repeat:
            self.repeat = False
            ends = self.line.now + self.line.wire(len(request) + 3.5) + takes + self.line.wire(len(answer))
            self.due = ends + self.chance.uniform(0, 2 * TIMEOUT)
            self.line.comes(self.due, answer)
        return [(takes, answer)]

    def _registers(self, address: int, count: int) -> bytes:
        held = {LIMIT: 0, LIMIT + 1: self.asked % ROUND}  # limit_low, in µm
        renewed = int(self.line.now * RENEWALS)
        reading = renewed % 1000
        display = struct.unpack(">8H", struct.pack(">HHifHH", 1, 0, reading, float(reading), renewed % 65536, 0))
        held |= {DISPLAY + at: value for at, value in enumerate(display)}
        if self.moves:
            held |= {POSITION: 0, POSITION + 1: self.asked % ROUND}
        return struct.pack(f">{count}H", *(held.get(at, 0) for at in range(address, address + count)))

    def end(self) -> None:
        """End a try: all that was said has come."""
        self.line.now = max(self.line.now, self.due) + SLOWEST + AIM

    def now_ns(self) -> int:
        """It is the drivers' clock as well."""
        return round(1e9 * self.line.now)

    def wait(self, duration: float) -> None:
        self.line.now += duration

    def pause(self) -> None:
        """Wait until the next question: half of the time so that the repetition may come while its answer is due."""
        aimed = self.due - self.chance.uniform(0, AIM)
        self.line.now = max(self.line.now, aimed) if self.chance.random() < 0.5 else self.line.now
        self.line.now += 0.0 if self.chance.random() < 0.5 else self.chance.uniform(0, 0.3)


def read_lengths(chance: random.Random, tries: int) -> Counter[str]:
    """Reads that follow each other, which the driver makes unlike in length: only every second can be alike."""
    return _reads(Line(chance), tries, "lengths differ", "lengths alike", lambda age: not age % 2, _first_limit)


def read_polls(chance: random.Random, tries: int) -> Counter[str]:
    """Polls of position and status, which have no neighbour: of any three reads in a row no two are alike."""
    wire = Line(chance)
    wire.moves = True
    return _reads(wire, tries, "polls", "polls alike", lambda age: age >= UNLIKE, lambda driver: driver.look()[0])


def _first_limit(driver: MicroPositioner) -> float:
    return driver.get_many("limit_low", "limit_high")[0]


def _reads(
    wire: Line, tries: int, unlike: str, alike: str, is_alike: Callable[[int], bool], ask: Callable[..., float]
) -> Counter[str]:
    """Two to four reads a try, of which one reply comes again, late: how often it is taken for a later one."""
    found = Counter[str]()
    driver = MicroPositioner(wire.link, UNIT, wire)
    for _ in range(tries):
        wire.repeat = True
        for again in range(wire.chance.randint(2, 4)):
            if again:
                wire.pause()
            try:
                told = round(1e6 * ask(driver))
            except BenchError:
                found[f"{unlike}: errors"] += 1
                continue
            if age := (wire.asked - told) % ROUND:
                found[f"{alike if is_alike(age) else unlike}: stale"] += 1
        wire.end()
        found[f"{unlike}: tries"] += 1
    return found


def read_counter(chance: random.Random, tries: int) -> Counter[str]:
    """Readings of a display that counts its renewals."""
    found = Counter[str]()
    wire = Line(chance)
    driver = StrainIndicator(wire.link, UNIT, wire)
    for _ in range(tries):
        wire.repeat = True
        for again in range(chance.randint(2, 4)):
            if again:
                wire.pause()
            begun = int(wire.line.now * RENEWALS)
            try:
                told = driver.read()
            except BenchError:
                found["counter: refused"] += 1
                continue
            found["counter: stale"] += (round(told.reading_mV) - begun) % 1000 > 500
        wire.end()
        found["counter: tries"] += 1
    return found


def write_twice(chance: random.Random, tries: int) -> Counter[str]:
    """The same registers are written twice, and the device does not hear the second write."""
    found = Counter[str]()
    wire = Line(chance)
    driver = MicroPositioner(wire.link, UNIT, wire)
    for _ in range(tries):
        wire.repeat, wire.deaf = True, False
        driver.set(speed=1e-3)
        wire.pause()
        wire.deaf = True
        try:
            driver.set(speed=2e-3)
            found["writes alike: wrongly confirmed"] += 1
        except BenchError:
            pass
        wire.end()
        found["writes alike: tries"] += 1
    return found


class Node:
    """A CANopen node whose answers come on a bus of pure arithmetic; one of them comes again, late."""

    def __init__(self, chance: random.Random) -> None:
        self._chance = chance
        self.now = self.due = 0.0
        self.asked = self.said = 0
        self.repeat = False
        self._coming: list[tuple[float, bytes]] = []
        self._left = b""
        self.sdo: Any = CheckedSdoClient(0x601, 0x581, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        self.sdo.network, self.sdo.responses, self.sdo.RESPONSE_TIMEOUT = self, self, TIMEOUT
        self.sdo.now = lambda: self.now
        self.sdo.shortest = shortest_transfer(BITRATE)

    def send_message(self, _cob_id: int, request: bytes) -> None:
        if request[0] == 0x80:
            return
        answer = self._answer(bytes(request))
        at = self.now + shortest_transfer(BITRATE) + self._chance.uniform(0, SLOWEST)
        self._coming.append((at, answer))
        if self.repeat:
            self.repeat = False
            self.due = at + self._chance.uniform(0, 2 * TIMEOUT)
            self._coming.append((self.due, answer))

    def _answer(self, request: bytes) -> bytes:
        self.asked += 1
        if request[0] & 0xE0 == 0x60:
            part, self._left = self._left[:7], self._left[7:]
            last = not self._left
            return bytes([request[0] & 0x10 | (7 - len(part)) << 1 | last]) + part.ljust(7, b"\0")
        if request[1:3] == b"\x08\x10":
            self._left = b"%020d" % self.said
            return b"\x41" + request[1:4] + (20).to_bytes(4, "little")
        return b"\x43" + request[1:4] + self.asked.to_bytes(4, "little")

    def empty(self) -> bool:
        return not any(at <= self.now for at, _ in self._coming)

    def get(self, timeout: float = 0.0) -> bytes:
        self._coming.sort(key=lambda one: one[0])
        if not self._coming or self._coming[0][0] > self.now + timeout:
            self.now += timeout
            raise queue.Empty
        at, answer = self._coming.pop(0)
        self.now = max(self.now, at)
        return answer

    def end(self) -> None:
        """End a try: what was repeated has come."""
        self.now = max(self.now, self.due)

    def pause(self) -> None:
        self.now = max(self.now, self.due - self._chance.uniform(0, AIM)) if self._chance.random() < 0.5 else self.now


def sdo_objects(chance: random.Random, tries: int) -> Counter[str]:
    """Two objects in turn, or the same one twice."""
    found = Counter[str]()
    node = Node(chance)
    for _ in range(tries):
        node.repeat = True
        node.sdo.upload(0x2001, 0, 4)
        node.pause()
        same = chance.random() < 0.5
        kind = "same object" if same else "other object"
        told = int.from_bytes(node.sdo.upload(0x2001 if same else 0x2002, 0, 4), "little")
        found[f"{kind}: stale"] += told != node.asked
        node.end()
        found[f"{kind}: tries"] += 1
    return found


def sdo_segments(chance: random.Random, tries: int) -> Counter[str]:
    """Two texts in segments, each read twice; any frame of the first may come again in it or in the second."""
    found = Counter[str]()
    node = Node(chance)
    for _ in range(tries):
        repeated = chance.randrange(8)
        for _text in range(2):
            begun = node.asked + 1
            send = node.send_message

            def counted(cob_id: int, request: bytes, begun: int = begun, send: Any = send, at: int = repeated) -> None:
                node.repeat = node.repeat or (node.asked + 1 - begun == at and request[0] != 0x80)
                send(cob_id, request)

            node.sdo.network = SimpleNamespace(send_message=counted)  # all that an SDO client wants of it
            try:
                node.said += 1
                told = node.sdo.upload(0x1008, 0)
                found["segments: wrong"] += told != b"%020d" % node.said
            except Exception:
                found["segments: refused"] += 1
            node.sdo.network = node
        node.end()
        found["segments: tries"] += 1
    return found


KINDS: dict[str, tuple[Callable[[random.Random, int], Counter[str]], float]] = {
    "lengths differ": (read_lengths, 0.25),
    "polls": (read_polls, 0.1),
    "counter": (read_counter, 0.2),
    "writes alike": (write_twice, 0.1),
    "objects": (sdo_objects, 0.25),
    "segments": (sdo_segments, 0.1),
}


def tried(number: int, tries: int) -> Counter[str]:
    """What came of block `number` of so many tries."""
    chance = random.Random(number)
    return sum((kind(chance, round(share * tries)) for kind, share in KINDS.values()), Counter[str]())
