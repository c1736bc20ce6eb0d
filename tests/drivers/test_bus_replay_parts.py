"""A replay by itself: which logs it takes, which requests are signs of life, and what must be as it was."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import can
import pytest

from palpate.drivers.logs.bus_log import Link, Packet, PcapngWriter
from palpate.drivers.logs.bus_replay import BusReplay, _confirmed, _is_heartbeat, _same, _without_heartbeats
from palpate.instrument.errors import ConfigError, UsageError

BENCH = (Path(__file__).parents[1] / "frozen" / "old" / "bench-least.toml").read_text()
RUN = Packet(1, "run", Link.NOTE, True, json.dumps({"bench": BENCH}).encode())
AMPLIFIER = "shaker_amplifier"
HEAD = bytes.fromhex("0001 0000 0006 05")


def clock(value: int) -> Packet:
    return Packet(2, "clock", Link.NOTE, True, str(value).encode())


def log_of(tmp_path: Path, *packets: Packet) -> Path:
    path = tmp_path / "t.pcapng"
    with path.open("wb") as file:
        writer = PcapngWriter(file)
        for packet in packets:
            writer.write(packet)
        writer.end()
    return path


def shown(packet: Packet) -> str:
    return f"{packet.who} {packet.data.decode(errors='replace')}"


# --- which logs ----------------------------------------------------------------------------------------


def test_a_log_gives_the_header_of_its_run_and_the_bench_of_it(tmp_path: Path) -> None:
    replay = BusReplay(log_of(tmp_path, RUN), shown)
    assert replay.run == {"bench": BENCH}
    assert replay.description.name
    assert replay.goes_on  # nobody reads its clock to feed a watchdog


def test_a_log_in_which_no_run_began_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"t\.pcapng: no run began in this log; replay a log that --log recorded of a"
    ):
        BusReplay(log_of(tmp_path), shown)


def test_a_damaged_log_and_one_that_cannot_be_read_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = log_of(tmp_path, RUN)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ConfigError, match=r"t\.pcapng: damaged: cut short at byte \d+; only a whole log can be"):
        BusReplay(path, shown)

    def refused(*_: object, **__: object) -> Any:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refused)
    with pytest.raises(UsageError, match=r"t\.pcapng: cannot be read: Permission denied; check the name$"):
        BusReplay(path, shown)


def test_beside_a_can_log_stands_the_one_that_is_replayed(tmp_path: Path) -> None:
    path = log_of(tmp_path, RUN)
    path.with_suffix(".blf").touch()
    assert BusReplay(path.with_suffix(".blf"), shown).path == path
    with pytest.raises(UsageError, match=r"t\.asc: cannot be read: No such file or directory; check the name$"):
        BusReplay(path.with_suffix(".asc"), shown)


# --- what must be as it was ----------------------------------------------------------------------------


def test_the_clock_gives_the_times_of_the_log_and_waits_take_none(tmp_path: Path) -> None:
    replay = BusReplay(log_of(tmp_path, RUN, clock(17), clock(99)), shown)
    assert replay.now_ns() == 17
    replay.wait(1e9)
    assert replay.now_ns() == 99
    with pytest.raises(ConfigError, match=r"t\.pcapng: the replay sends 'clock ', but the log ends here; only a run"):
        replay.now_ns()


@pytest.mark.parametrize(
    ("who", "link", "data", "same"),
    [
        ("oven", Link.TCP, b"\0\1rest", True),
        ("oven", Link.TCP, b"\7\7rest", True),  # the number of a request
        ("oven", Link.TCP, b"\0\1Rest", False),
        ("oven", Link.LINE, b"\0\1rest", False),
        ("fan", Link.TCP, b"\0\1rest", False),
    ],
)
def test_requests_are_the_same_but_for_their_numbers_on_tcp(who: str, link: Link, data: bytes, same: bool) -> None:
    recorded = Packet(1, "oven", Link.TCP, True, b"\0\1rest")
    assert _same(recorded, Packet(2, who, link, True, data)) is same


@pytest.mark.parametrize("link", [Link.LINE, Link.CAN])
def test_on_other_links_each_byte_counts(link: Link) -> None:
    recorded = Packet(1, "oven", link, True, b"\0\1rest")
    assert _same(recorded, Packet(2, "oven", link, True, b"\0\1rest"))
    assert not _same(recorded, Packet(2, "oven", link, True, b"\7\1rest"))


def test_readings_of_the_clock_are_the_same_whatever_the_time() -> None:
    assert _same(clock(1), clock(2))
    assert not _same(clock(1), Packet(1, "run", Link.NOTE, True, b"1"))


def test_frames_of_the_bus_come_before_the_action_that_follows_them_and_after_the_one_before(tmp_path: Path) -> None:
    def frame(identifier: int) -> Packet:
        return Packet(3, "node", Link.CAN, False, identifier.to_bytes(4, "big") + bytes(4))

    late = Packet(3, "oven", Link.TCP, False, b"reply")
    log = log_of(tmp_path, RUN, frame(0x581), clock(1), frame(0x582), late, frame(0x583), clock(2), frame(0x584))
    with ExitStack() as stack:
        replay = stack.enter_context(BusReplay(log, shown))
        link: Any = replay.description.links["can"]
        bus = stack.enter_context(can.Bus(interface="virtual", channel=link.channel))

        def heard() -> list[int]:
            return [message.arbitration_id for message in iter(lambda: bus.recv(0), None)]

        assert heard() == []
        replay.now_ns()
        assert heard() == [0x581, 0x582, 0x583]
        replay.now_ns()
        assert heard() == [0x584]


def test_the_answer_to_a_request_is_what_the_same_device_said_before_it_was_asked_again(tmp_path: Path) -> None:
    def packet(who: str, sent: bool, data: bytes = b"") -> Packet:
        return Packet(3, who, Link.TCP, sent, data)

    replay = BusReplay(
        log_of(
            tmp_path,
            RUN,
            packet("oven", True),
            packet("fan", True),
            packet("fan", False, b"windy"),
            packet("oven", False, b"warm"),
            packet("oven", True),
            packet("oven", True),
        ),
        shown,
    )
    assert [replay._reply(at) for at in (0, 1, 4, 5)] == [b"warm", b"windy", b"", b""]


# --- signs of life -------------------------------------------------------------------------------------

TOKEN = bytes.fromhex("10 0040 0004 08 00070001")  # a write of token and counter
LOOK = bytes.fromhex("03 0025 0001")  # a read of the status


@pytest.mark.parametrize(
    ("request_", "alive"),
    [
        (TOKEN + bytes.fromhex("00000002"), True),
        (TOKEN + bytes.fromhex("00000001"), False),  # claims it
        (bytes.fromhex("10 0040 0006 0c 00070001 00000002 0012 0001"), False),  # an order
        (LOOK, True),
        (LOOK + b"\0", False),
        (bytes.fromhex("03 0024 0001"), False),
    ],
)
def test_a_sign_of_life_feeds_the_watchdog_and_does_nothing_else(request_: bytes, alive: bool) -> None:
    for who in (AMPLIFIER, f"left ({AMPLIFIER})"):
        assert _is_heartbeat(Packet(1, who, Link.TCP, True, HEAD + request_)) is alive
    assert not _is_heartbeat(Packet(1, AMPLIFIER, Link.TCP, False, HEAD + request_))
    assert not _is_heartbeat(Packet(1, "signal_generator", Link.TCP, True, HEAD + request_))


@pytest.mark.parametrize(
    ("request_", "reply"),
    [
        (TOKEN + bytes.fromhex("00000002"), "0001 0000 0006 05 10 0040 0004"),
        (LOOK, "0001 0000 0005 05 03 02 0000"),
    ],
)
def test_a_sign_of_life_is_confirmed_as_the_device_would(request_: bytes, reply: str) -> None:
    assert _confirmed(HEAD + request_) == bytes.fromhex(reply)


def test_signs_of_life_and_the_answers_to_them_are_left_out_of_a_log() -> None:
    def packet(who: str, sent: bool, data: bytes) -> Packet:
        return Packet(1, who, Link.TCP, sent, HEAD + data)

    kept = [
        packet(AMPLIFIER, False, b"of before"),
        packet(AMPLIFIER, True, b"order"),
        packet(AMPLIFIER, False, b"done"),
        packet("oven", True, LOOK),
        packet("oven", False, b"warm"),
    ]
    beat, answer = packet(AMPLIFIER, True, LOOK), packet(AMPLIFIER, False, b"\3\2\0\0")
    packets = [kept[0], beat, answer, *kept[1:3], beat, kept[3], answer, kept[4]]
    assert list(_without_heartbeats(packets)) == kept
