"""What the client's and the simulated end of a CAN bus both need."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from palpate.instrument.own_process import close_in_child

MULTICAST = "udp_multicast"  # name of python-can's interface; each bus on it also receives its own frames
RECEIVE_BUFFER = 4 << 20  # bytes; the system's default size holds only 256 frames
# by family: level and Linux' option by which a socket hears its own groups alone; `socket` has no names for them
OWN_GROUPS = {socket.AF_INET: (socket.IPPROTO_IP, 49), socket.AF_INET6: (socket.IPPROTO_IPV6, 29)}
WITHIN_MACHINE: dict[str, Any] = {"hop_limit": 0}  # option of python-can for the multicast bus: no frame goes farther


def keep_to_group(bus: Any) -> None:
    """Let a new multicast bus hear frames of its own group alone, and give it a large buffer.

    Linux gives a socket that is bound to a port the datagrams of every group that any program of the machine has joined
    on that port. Those that came before this call are thrown away. Anybody can also send to the group what is no frame,
    at which python-can would end its thread; that is passed over.
    """
    with socket.socket(fileno=os.dup(bus.fileno())) as end:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        end.setsockopt(*OWN_GROUPS[end.family], 0)
        with suppress(BlockingIOError):
            while True:
                end.recv(1, socket.MSG_DONTWAIT)
    bus._recv_internal = partial(_received, bus._recv_internal)


def _received(receive: Callable[[float | None], Any], timeout: float | None) -> Any:
    """What python-can receives; nothing if a datagram is no frame. Raises can.CanError: the bus has failed."""
    try:
        return receive(timeout)
    except Exception as error:
        if error.__cause__ is None or isinstance(error.__cause__, OSError):
            raise
        return None, False


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
