"""Listens to a CAN bus without taking part in it: a node with a wrong bit rate destroys the frames of all others."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import can

from palpate.drivers.clock import WallClock
from palpate.drivers.links import causes
from palpate.drivers.links.can import has_wire
from palpate.instrument.bench.can_ends import MULTICAST, keep_to_group
from palpate.instrument.bench.links import CanBus
from palpate.instrument.errors import LinkError

# how python-can's interfaces are told only to listen, by their own arguments (their documentation, python-can 4)
LISTEN_ONLY: dict[str, dict[str, Any]] = {
    "cantact": {"monitor": True},
    "kvaser": {"driver_mode": False},
    "nixnet": {"listen_only": True},
    "pcan": {"state": can.BusState.PASSIVE},
    "seeedstudio": {"operation_mode": "silent"},
    "slcan": {"listen_only": True},
    "systec": {"state": can.BusState.PASSIVE},
    "vector": {"listen_only": True},
}
SET_BY_SYSTEM = (
    "socketcan",
    MULTICAST,
    "virtual",
)  # opening these sets no bit rate
HEARTBEATS, EMERGENCIES, ANSWERS = range(0x701, 0x780), range(0x81, 0x100), range(0x581, 0x600)


@dataclass
class Heard:
    """What was heard on a bus: number of data frames, number of error frames, and the node ids that sent some."""

    frames: int = 0
    errors: int = 0
    nodes: set[int] = field(default_factory=set)


def listens_quietly(bus: CanBus) -> bool:
    """Whether opening the bus to listen disturbs nobody, even with a wrong bit rate."""
    return bus.interface in LISTEN_ONLY or bus.interface in SET_BY_SYSTEM or not has_wire(bus)


def listen(bus: CanBus, seconds: float) -> Heard:
    """Listen for so many seconds. Raises LinkError: the bus cannot be opened, or failed."""
    heard, clock = Heard(), WallClock()
    try:
        with can.Bus(
            interface=bus.interface, channel=bus.channel, bitrate=bus.bitrate, **LISTEN_ONLY.get(bus.interface, {})
        ) as opened:
            if bus.interface == MULTICAST:
                keep_to_group(opened)
            while (left := seconds - 1e-9 * clock.now_ns()) > 0:
                if (frame := opened.recv(left)) is not None:
                    _count(heard, frame)
    except Exception as error:  # each interface of python-can raises other types, even NameError
        where = "--can INTERFACE:CHANNEL"
        raise LinkError(causes.no_bus(bus.interface, bus.channel, bus.bitrate, error, where)) from error
    return heard


def _count(heard: Heard, frame: can.Message) -> None:
    if frame.is_error_frame:
        heard.errors += 1
        return
    heard.frames += 1
    if frame.is_extended_id or frame.is_remote_frame:
        return
    for identifiers in (HEARTBEATS, EMERGENCIES, ANSWERS):
        if frame.arbitration_id in identifiers:
            heard.nodes.add(frame.arbitration_id & 0x7F)
