"""Late replies where frames have no number; `python -m tests.benchmarks stale` tries a million."""

from __future__ import annotations

import queue
import random
from typing import Any

import canopen
import pytest
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from drivers.sdo import CheckedSdoClient
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


@pytest.mark.parametrize("kind", ["lengths differ", "counter"])
def test_without_the_drivers_care_the_same_tries_find_late_replies(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("instrument.contract.Contract.widened", lambda _contract, names: names)
    monkeypatch.setattr("drivers.strain_indicator.COUNTED_NS", 0)
    assert KINDS[kind][0](random.Random(1), 150)[f"{kind}: stale"] > 0


# --- SDO answers, one by one -------------------------------------------------------------------------------


class Answers:
    """A network that answers each request with these frames."""

    def __init__(self, *frames: str) -> None:
        self._frames = [bytes.fromhex(frame) for frame in frames]
        self.sdo: Any = CheckedSdoClient(0x601, 0x581, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        self.sdo.network, self.sdo.RESPONSE_TIMEOUT = self, 1e-9

    def send_message(self, _cob_id: int, request: bytes) -> None:
        if request[0] != 0x80:
            for frame in self._frames:
                self.sdo.on_response(0x581, bytearray(frame), 0.0)


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
    assert Answers(late, READ_2000).sdo.upload(0x2000, 0) == bytes.fromhex("78563412")
    with pytest.raises(SdoCommunicationError):
        Answers(late).sdo.upload(0x2000, 0)


def test_what_came_before_it_was_asked_for_is_thrown_away() -> None:
    answers = Answers(READ_2000)
    answers.sdo.on_response(0x581, bytearray.fromhex("43 00 20 00 01 00 00 00"), 0.0)
    assert answers.sdo.upload(0x2000, 0) == bytes.fromhex("78563412")


@pytest.mark.parametrize("who", ["00 20 00", "00 00 00"])
def test_an_abort_of_the_transfer_ends_it(who: str) -> None:
    with pytest.raises(SdoAbortedError) as abort:
        Answers(f"80 {who} 11 00 09 06").sdo.upload(0x2000, 0)
    assert abort.value.code == 0x0609_0011


def test_a_node_that_does_not_say_how_many_bytes_count_gives_those_of_the_object() -> None:
    sdo = Answers("42 17 10 00 F4 01 AA BB").sdo
    assert sdo.upload(0x1017, 0, 2) == bytes.fromhex("F401")


def test_a_node_that_never_stops_answering_is_a_time_out() -> None:
    class Endless(queue.Queue[bytes]):
        def get(self, block: bool = True, timeout: float | None = None) -> bytes:
            return bytes.fromhex("43 01 20 00 01 00 00 00")

    answers = Answers()
    answers.sdo.responses = Endless()
    with pytest.raises(SdoCommunicationError):
        answers.sdo.upload(0x2000, 0)
