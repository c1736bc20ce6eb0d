"""Late replies where frames have no number, and SDO answers one by one; `tests.benchmarks stale` tries a million.

The tries stand on wires of pure arithmetic. Each asks a few times, and one of the answers is repeated up to two
time-outs later, half of the time aimed at the moment when a later answer is due. `Counter` names: of each kind the
tries, the repetitions that could be taken for the answer that was due, and what was taken.
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
import pytest
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from palpate.drivers.devices.load_indicator import StrainIndicator
from palpate.drivers.devices.positioner import MicroPositioner
from palpate.drivers.links.can import FRAME, LATE_ANSWERS, CheckedSdoClient, has_wire
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench import links
from palpate.instrument.contracts.own import POSITIONER, STRAIN_INDICATOR, shortest_transfer
from palpate.instrument.errors import BenchError
from tests.drivers.fake_links import VirtualLine, checked

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


# --- tries -------------------------------------------------------------------------------------------

TRIES = 200


@pytest.fixture(scope="module")
def found() -> dict[str, int]:
    return tried(1, TRIES)


@pytest.mark.parametrize("what", NONE)
def test_no_late_reply_is_taken_where_lengths_differ_or_something_counts(what: str, found: dict[str, int]) -> None:
    assert found[f"{what.partition(':')[0]}: tries"] > TRIES / 20
    assert found[what] == 0


def test_the_tries_are_hard_late_replies_are_taken_where_nothing_tells_them(found: dict[str, int]) -> None:
    assert found["lengths alike: stale"] > 0
    assert found["same object: stale"] > 0
    assert found["writes alike: wrongly confirmed"] > 0
    assert {kind for kind, _ in KINDS.values()} and set(TOLD).isdisjoint(NONE)


@pytest.mark.parametrize("kind", ["lengths differ", "polls", "counter"])
def test_without_the_drivers_care_the_same_tries_find_late_replies(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.drivers.links.modbus.ModbusLink.serial", False)  # whose reads may be alike
    monkeypatch.setattr("palpate.drivers.devices.load_indicator.COUNTED_NS", 0)
    monkeypatch.setattr(MicroPositioner, "look", lambda driver: driver.get_many("position", "status"))
    assert KINDS[kind][0](random.Random(1), 150)[f"{kind}: stale"] > 0


# --- SDO answers, one by one -------------------------------------------------------------------------------


class Client(CheckedSdoClient):
    """Each request is answered with the next of these, of one frame or several."""

    def __init__(self, *answers: str) -> None:
        super().__init__(0x601, 0x581, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        self.answers = iter(answers)
        self.requests: list[str] = []
        self.RESPONSE_TIMEOUT = 1e-9

    def send_request(self, request: bytes) -> None:
        self.requests.append(bytes(request).hex(" "))
        if request[0] != 0x80:
            for answer in next(self.answers).split(","):
                self.on_response(0x581, bytearray(bytes.fromhex(answer).ljust(8, b"\0")), 0.0)


READ_2000 = "43 00 20 00 78 56 34 12"


@pytest.mark.parametrize(
    "late",
    [
        "43 01 20 00 01 00 00 00",  # another object
        "4F 00 20 01 01 00 00 00",  # another subindex
        "60 00 20 00 00 00 00 00",  # it was written
        "00 61 62 63 64 65 66 67",  # a segment
        "80 01 20 00 00 00 02 06",  # another transfer was aborted
    ],
)
def test_an_answer_to_another_request_is_passed_over(late: str) -> None:
    assert Client(f"{late}, {READ_2000}").upload(0x2000, 0) == bytes.fromhex("78563412")
    with pytest.raises(SdoCommunicationError):
        Client(late).upload(0x2000, 0)


def test_a_node_that_never_stops_answering_is_a_time_out() -> None:
    class Endless(queue.Queue[bytes]):
        def get(self, block: bool = True, timeout: float | None = None) -> bytes:
            return bytes.fromhex("43 01 20 00 01 00 00 00")

    client = Client("")
    client.responses = Endless()
    with pytest.raises(SdoCommunicationError):
        client.upload(0x2000, 0)


# --- answers that no wire can bring so soon ------------------------------------------------------------------


def node_that_answers_after(seconds: float, bitrate: float) -> CheckedSdoClient:
    """Its client; a stale answer comes at once, the one to the request after so many s."""
    now = [0.0]
    stale, fresh = (bytes.fromhex(f"43 00 20 00 {data} 00 00 00") for data in ("01", "02"))
    answers: queue.Queue[bytes] = queue.Queue()

    class Answered(CheckedSdoClient):
        def send_request(self, request: bytes) -> None:
            if request[0] != 0x80:
                self.responses.put(stale)
                self.responses.put(fresh)

        def now(self) -> float:
            now[0] += seconds if self.responses.qsize() == 0 else 0.0
            return now[0]

    node = Answered(0x601, 0x581, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
    node.responses, node.shortest, node.RESPONSE_TIMEOUT = answers, shortest_transfer(bitrate), 1.0
    return node


@pytest.mark.parametrize("bitrate", [10e3, 125e3, 1e6])
def test_an_answer_that_comes_before_two_frames_can_pass_is_none(bitrate: float) -> None:
    node = node_that_answers_after(1.01 * 2 * 108 / bitrate, bitrate)
    assert (node.upload(0x2000, 0, 4), node.too_soon) == (b"\2\0\0\0", 1)


@pytest.mark.parametrize(
    ("bus", "wire"),
    [
        ({"interface": "pcan", "channel": "PCAN_USBBUS1"}, True),
        ({"interface": "socketcan", "channel": "can0"}, True),
        ({"interface": "socketcan", "channel": "lo"}, False),  # as vcan0 is: a device of Linux without hardware
        ({"interface": "virtual", "channel": "here"}, False),
        ({"interface": "udp_multicast", "channel": "239.74.0.1"}, False),
    ],
)
def test_a_bus_within_the_machine_may_answer_at_once(bus: dict[str, Any], wire: bool) -> None:
    assert has_wire(links.CanBus(**bus)) is wire


def test_a_text_that_says_two_things_when_it_is_read_twice_is_not_used() -> None:
    with pytest.raises(SdoCommunicationError, match="different values"):
        Client("41 08 10 00 02", "0B 61 62", "41 08 10 00 02", "0B 61 63").upload(0x1008, 0)


# --- SDO transfers -------------------------------------------------------------------------------------


TEXT = ["41 08 10 00 09", "00 70 61 6c 70 61 74 65", "1b 21 21"]  # nine bytes in two segments, the last of two


@pytest.mark.parametrize(
    ("answers", "place", "data", "asked"),
    [
        ([*TEXT, *TEXT], (0x1008, 0), b"palpate!!", ["40", "60", "70"] * 2),
        (["40 08 10 00", *TEXT[1:]] * 2, (0x1008, 0, 4), b"palpate!!", ["40", "60", "70"] * 2),  # it tells no size
        (["4b 17 10 00 f4 01"], (0x1017, 0, 2), b"\xf4\x01", ["40"]),
        (["43 17 10 00 f4 01 02 03"], (0x1017, 0, 2), b"\xf4\x01\x02\x03", ["40"]),  # what it says counts
        (["42 17 10 00 f4 01 aa bb"], (0x1017, 0, 2), b"\xf4\x01", ["40"]),  # it does not say how many bytes count
        (["42 17 10 00 f4 01 02 03"], (0x1017, 0), b"\xf4\x01\x02\x03", ["40"]),
    ],
)
def test_a_number_in_one_frame_is_read_once_and_a_text_in_segments_twice(
    answers: list[str], place: tuple[int, ...], data: bytes, asked: list[str]
) -> None:
    client = Client(*answers)
    assert client.upload(*place) == data
    assert [request[:2] for request in client.requests] == asked


@pytest.mark.parametrize("announced", [8, 10])
def test_an_object_of_another_size_than_announced_is_refused(announced: int) -> None:
    answers = [f"41 08 10 00 {announced:02x}", *TEXT[1:]]
    with pytest.raises(SdoCommunicationError, match=f"object of 9 bytes, {announced} were announced"):
        Client(*answers, *answers).upload(0x1008, 0)


def test_a_segment_of_the_wrong_turn_is_passed_over() -> None:
    """Its toggle bit is that of the segment before: it was repeated."""
    client = Client(TEXT[0], TEXT[1], "00 70 61 6c 70 61 74 65")
    with pytest.raises(SdoCommunicationError, match="no answer in time"):
        client.upload(0x1008, 0)
    assert client.requests[-1] == "80 00 00 00 00 00 04 05"  # abort: time-out, CiA 301


def test_answers_are_kept_that_have_eight_bytes_and_no_more_than_can_be_late() -> None:
    client = Client()
    for answers in range(LATE_ANSWERS + 5):
        client.on_response(0x581, bytearray(FRAME), 0.0)
        assert client.responses.qsize() == min(answers, LATE_ANSWERS) + 1
    for size in (0, 7, 9):
        other = Client()
        other.on_response(0x581, bytearray(size), 0.0)
        assert other.responses.empty()


def test_a_download_is_confirmed_by_its_object() -> None:
    client = Client("60 17 10 00")
    client.download(0x1017, 0, b"\xf4\x01")
    assert client.requests == ["2b 17 10 00 f4 01 00 00"]
    with pytest.raises(SdoCommunicationError):
        Client("60 17 10 01").download(0x1017, 0, b"\xf4\x01")
    with pytest.raises(SdoAbortedError, match="0x06090011"):
        Client("80 17 10 00 11 00 09 06").download(0x1017, 0, b"\xf4\x01")


def test_a_text_is_written_in_segments_whose_toggle_bits_are_confirmed() -> None:
    client = Client("60 30 20 00", "20", "30")
    client.download(0x2030, 0, b"palpate!!")
    assert client.requests == ["21 30 20 00 09 00 00 00", "00 70 61 6c 70 61 74 65", "1b 21 21 00 00 00 00 00"]
    with pytest.raises(SdoCommunicationError, match="no answer in time"):
        Client("60 30 20 00", "20", "20").download(0x2030, 0, b"palpate!!")  # the second was not confirmed
