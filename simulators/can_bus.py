"""The CAN bus that simulated nodes share with whoever talks to them."""

from __future__ import annotations

import itertools
import logging
import os
from typing import Any

import can
from canopen.network import MessageListener

from instrument.errors import BenchError
from instrument.multicast import MULTICAST, keep_to_group

for _name in ("can", "canopen"):
    logging.getLogger(_name).addHandler(logging.NullHandler())  # what a client sends is no news on our stderr

_numbers = itertools.count(1)


def own_channel(interface: str) -> str:
    """A channel of python-can that no other bench of this machine uses."""
    number = next(_numbers)
    if interface == MULTICAST:
        return f"239.74.{os.getpid() % 256}.{number % 256}"
    return f"palpate-{os.getpid()}-{number}"


def open_bus(interface: str, channel: str) -> can.BusABC:
    """A bus of python-can. Raises BenchError."""
    options: dict[str, Any] = {"hop_limit": 0} if interface == MULTICAST else {}  # does not leave this machine
    try:
        bus = can.Bus(interface=interface, channel=channel, **options)
    except Exception as error:  # each interface of python-can has its own, down to NameError
        raise BenchError(f"CAN bus {interface}:{channel} cannot be opened: {error}; give another interface") from error
    if interface == MULTICAST:
        keep_to_group(bus.fileno())
    return bus


class Listener(MessageListener):
    """canopen's listener, which takes an extended identifier for the standard one; what is no frame ends nothing."""

    def on_message_received(self, msg: can.Message) -> None:
        if not (msg.is_extended_id or msg.is_fd):
            super().on_message_received(msg)  # type: ignore[no-untyped-call]

    def on_error(self, exc: Exception) -> None:
        """Goes on, unless the bus itself has failed."""
        if isinstance(exc.__cause__, OSError) or self.network.notifier is None:
            raise NotImplementedError
        self.network.notifier.exception = None  # canopen would send nothing any more
