"""The client's end of SDO transfers: which frames belong to a transfer, and what makes an object."""

from __future__ import annotations

import canopen
import pytest
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from palpate.drivers.links.can import FRAME, LARGEST_OBJECT, LATE_ANSWERS, CheckedSdoClient


class Client(CheckedSdoClient):
    """Each request is answered with these frames."""

    def __init__(self, *answers: str) -> None:
        super().__init__(0x601, 0x581, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        self.answers = iter(answers)
        self.requests: list[str] = []
        self.RESPONSE_TIMEOUT = 1e-9

    def send_request(self, request: bytes) -> None:
        self.requests.append(bytes(request).hex(" "))
        if request[0] != 0x80:
            self.on_response(0x581, bytearray(bytes.fromhex(next(self.answers)).ljust(8, b"\0")), 0.0)


TEXT = ["41 08 10 00 09", "00 70 61 6c 70 61 74 65", "1b 21 21"]  # nine bytes in two segments, the last of two


def test_a_text_in_segments_is_read_twice() -> None:
    client = Client(*TEXT, *TEXT)
    assert client.upload(0x1008, 0) == b"palpate!!"
    assert [request[:2] for request in client.requests] == ["40", "60", "70"] * 2


def test_a_number_in_one_frame_is_read_once() -> None:
    client = Client("4b 17 10 00 f4 01")
    assert client.upload(0x1017, 0, 2) == b"\xf4\x01"
    assert client.requests == ["40 17 10 00 00 00 00 00"]


def test_a_size_that_the_node_says_counts_against_the_one_that_was_expected() -> None:
    assert Client("43 17 10 00 f4 01 02 03").upload(0x1017, 0, 2) == b"\xf4\x01\x02\x03"
    assert Client("42 17 10 00 f4 01 02 03").upload(0x1017, 0) == b"\xf4\x01\x02\x03"


@pytest.mark.parametrize("announced", [8, 10])
def test_an_object_of_another_size_than_announced_is_refused(announced: int) -> None:
    answers = [f"41 08 10 00 {announced:02x}", *TEXT[1:]]
    with pytest.raises(SdoCommunicationError, match=f"object of 9 bytes, {announced} were announced"):
        Client(*answers, *answers).upload(0x1008, 0)


def test_a_text_of_no_announced_size_is_read_to_its_end() -> None:
    answers = ["40 08 10 00", *TEXT[1:]]
    assert Client(*answers, *answers).upload(0x1008, 0, 4) == b"palpate!!"


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
