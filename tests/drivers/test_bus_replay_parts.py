"""A replay by itself: which logs it takes, which requests are signs of life, and what must be as it was."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import can
import pytest

from palpate.drivers.logs.bus_log import Link, Packet, PcapngWriter
from palpate.drivers.logs.bus_replay import BusReplay
from palpate.instrument.errors import ConfigError, UsageError

BENCH = (Path(__file__).parents[1] / "frozen" / "old" / "bench-least.toml").read_text()
RUN = Packet(1, "run", Link.NOTE, True, json.dumps({"bench": BENCH}).encode())


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
