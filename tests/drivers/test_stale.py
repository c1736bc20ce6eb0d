"""Late replies where frames have no number, and SDO answers one by one; `tests.benchmarks stale` tries a million."""

from __future__ import annotations

import queue
import random
from typing import Any

import canopen
import pytest
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from palpate.drivers.devices.positioner import MicroPositioner
from palpate.drivers.links.can import FRAME, LARGEST_OBJECT, LATE_ANSWERS, CheckedSdoClient, has_wire
from palpate.instrument.bench import links
from palpate.instrument.contracts.own import shortest_transfer
from tests.stale import KINDS, NONE, TOLD, tried

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


def test_an_object_without_end_is_refused_after_the_largest() -> None:
    segments = [f"{toggle} 61 61 61 61 61 61 61" for toggle in ("00", "10")] * LARGEST_OBJECT
    client = Client("40 08 10 00", *segments)
    with pytest.raises(SdoCommunicationError, match="were announced"):
        client.upload(0x1008, 0)
    assert len([request for request in client.requests if request[0] in "67"]) == LARGEST_OBJECT // 7


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
