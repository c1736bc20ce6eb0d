"""What a bench that lies within this machine needs of it: a pseudo-terminal for its serial line, and loopback."""

from __future__ import annotations

import errno
import os
import socket
import termios
import tty

from palpate.instrument.errors import BenchError

LOOPBACK = "127.0.0.1"


def pseudo_terminal() -> tuple[int, int, str]:
    """The device's end and the client's end of a new serial line, as descriptors, and the name of the client's end.

    Raises BenchError: this machine gives none.
    """
    ends: tuple[int, ...] = ()
    try:
        ends = os.openpty()
        tty.setraw(ends[1])
        return ends[0], ends[1], os.ttyname(ends[1])
    except (OSError, termios.error) as error:
        for end in ends:
            os.close(end)
        raise BenchError(
            f"there is no pseudo-terminal for the simulated serial line ({error.args[-1]}), as in a container without "
            "them; mount them with: mount -t devpts -o ptmxmode=0666 devpts /dev/pts && ln -sf pts/ptmx /dev/ptmx"
        ) from None


def check_loopback(host: str) -> None:
    """Raises BenchError: `host` lies within this machine, and its loopback interface is down."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        try:
            if host == LOOPBACK:
                end.connect((host, 1))  # sends nothing
        except OSError as error:
            if error.errno == errno.ENETUNREACH:
                raise BenchError(
                    f"nothing can be reached at {host}, because the loopback interface of this machine is down; bring "
                    "it up with: ip link set lo up"
                ) from None
