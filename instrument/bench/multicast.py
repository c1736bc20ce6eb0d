"""Settings of a CAN bus over UDP multicast that both of its ends need."""

from __future__ import annotations

import os
import socket

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
