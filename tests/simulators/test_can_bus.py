"""A block of frames arrives whole where the receiver takes blocks, else as frames that are sent one by one."""

from __future__ import annotations

import itertools
from typing import Any

import can
import numpy as np
import pytest
from can.interfaces.virtual import VirtualBus

from palpate.instrument.bench.links import MULTICAST, Block, take_blocks
from palpate.instrument.errors import BenchError
from palpate.simulators.wire import can_bus
from palpate.simulators.wire.can_bus import hand_over, open_bus, own_channel

BLOCK = Block(
    np.array([1000, 2000]),
    [(0x80, np.empty((2, 0), np.uint8)), (0x181, np.arange(16, dtype=np.uint8).reshape(2, 8))],
)
FRAMES = [(0x80, b""), (0x181, bytes(range(8))), (0x80, b""), (0x181, bytes(range(8, 16)))]


def heard(*, singly: bool) -> list[tuple[int, bytes]]:
    channel = own_channel("virtual")
    with open_bus("virtual", channel) as sender, can.Bus(channel, "virtual") as receiver:
        if singly:
            sender.send = sender.send  # type: ignore[method-assign]  # as a fault stands in for it
        hand_over(sender, BLOCK)
        messages = [receiver.recv(0) for _ in FRAMES]
        assert receiver.recv(0) is None
        assert sender.recv(0) is None
    assert not any(m is None or m.is_extended_id for m in messages)
    return [(m.arbitration_id, bytes(m.data)) for m in messages if m is not None]


def test_a_block_is_heard_as_frames_sent_one_by_one() -> None:
    assert heard(singly=False) == heard(singly=True) == FRAMES


def test_a_receiver_that_takes_blocks_gets_one_whole_unless_a_fault_looks_at_its_frames() -> None:
    channel = own_channel("virtual")
    with open_bus("virtual", channel) as sender, VirtualBus(channel) as receiver:
        take_blocks(receiver.queue)
        hand_over(sender, BLOCK)
        sender.send = sender.send  # type: ignore[method-assign]  # as a fault stands in for it
        hand_over(sender, BLOCK)
        received: list[Any] = [receiver.recv(0) for _ in range(5)]
        assert receiver.recv(0) is None
    assert received[0] is BLOCK
    assert [(m.arbitration_id, bytes(m.data)) for m in received[1:]] == FRAMES


def test_two_benches_of_this_machine_never_share_a_multicast_group(monkeypatch: pytest.MonkeyPatch) -> None:
    """They do not even if the numbers of their processes lead to the same group."""
    monkeypatch.setattr(can_bus, "_numbers", itertools.count(1))
    group = own_channel(MULTICAST)
    monkeypatch.setattr(can_bus, "_numbers", itertools.count(1))
    with open_bus(MULTICAST, group):
        other = own_channel(MULTICAST)
        assert other != group
        with pytest.raises(BenchError, match=f"{group} is in use by another served bench; leave the channel out"):
            open_bus(MULTICAST, group)
    with open_bus(MULTICAST, group):
        pass
