"""What the client's and the simulated end of a CAN bus both need."""

from __future__ import annotations

import os
import socket
from typing import Any

from palpate.instrument.own_process import close_in_child

MULTICAST = "udp_multicast"  # name of python-can's interface; each bus on it also receives its own frames
RECEIVE_BUFFER = 4 << 20  # bytes; the system's default size holds only 256 frames
IP_MULTICAST_ALL = 49  # Linux' option; Python's `socket` has no name for it


def keep_to_group(descriptor: int) -> None:
    """Set up the socket of a bus: it hears its own group alone, and has a large buffer.

    Without this, Linux gives a socket that is bound to a port the frames of every group that any program of the machine
    has joined on that port.
    """
    with socket.socket(fileno=os.dup(descriptor)) as end:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        if end.family == socket.AF_INET:
            end.setsockopt(socket.IPPROTO_IP, IP_MULTICAST_ALL, 0)


def close_bus_in_child(bus: Any) -> None:
    """Let a fork close python-can's bus in the child, where nothing is sent at its end."""
    close_in_child(bus, _left_to_parent)


def _left_to_parent(bus: Any) -> list[int]:
    bus._is_shutdown = True  # else python-can would stop the cyclic frames of the kernel, which are the parent's
    ends = [*getattr(bus, "_bcm_sockets", {}).values()]
    return [end.fileno() for end in (ends if hasattr(bus, "queue") else [bus, *ends])]


def leave(network: Any) -> None:
    """Disconnect canopen's network from its bus, without a wait if the bus lies within this process.

    python-can's thread looks every `NOTIFIER_CYCLE` whether it shall stop. On its virtual bus anything that is
    put into the thread's queue wakes it; listeners are gone by then, so that nobody hears of it.
    """
    received = getattr(network.bus, "queue", None)
    if network.notifier is not None and received is not None:
        network.notifier.listeners.clear()
        network.notifier._stopped = True
        received.put(True)
    network.disconnect()
