"""A CAN bus over UDP multicast, as both of its ends need it."""

from __future__ import annotations

import os
import socket

MULTICAST = "udp_multicast"  # of python-can; it hands a bus its own frames as well
RECEIVE_BUFFER = 4 << 20  # bytes; the usual one holds 256 frames
IP_MULTICAST_ALL = 49  # of Linux; `socket` has no name for it


def keep_to_group(descriptor: int) -> None:
    """Have the socket of a bus hear its own group alone, whatever others of this machine have joined, and much of it.

    Linux gives a socket that is bound to a port the frames of every group on it.
    """
    with socket.socket(fileno=os.dup(descriptor)) as end:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        if end.family == socket.AF_INET:
            end.setsockopt(socket.IPPROTO_IP, IP_MULTICAST_ALL, 0)
