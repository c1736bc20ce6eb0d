"""Links of a bench, over which one or more of its devices are reached."""

from __future__ import annotations

import errno
import os
import re
import socket
import termios
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal, Protocol

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Field

from palpate.instrument.config import Config, check
from palpate.instrument.contracts.maps.map_file import Baudrate, Bitrate
from palpate.instrument.errors import BenchError, ConfigError
from palpate.instrument.own_process import close_in_child
from palpate.instrument.quantity import Seconds

# -------------------------------------------------------------------------------------------------------
# What a bench that lies within this machine needs of it: a pseudo-terminal for its serial line, and loopback

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


# --- What the client's and the simulated end of a CAN bus both need ------------------------------------

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


def arrived(bus: Any) -> list[Any]:
    """The frames that have come on a bus, without waiting for more. Raises can.CanError: the bus has failed."""
    if (received := getattr(bus, "queue", None)) is None:
        return list(iter(partial(bus.recv, 0), None))
    if not received.queue:
        return []
    with received.mutex:  # python-can's virtual bus: all at once, a tenth of the time
        frames = list(received.queue)
        received.queue.clear()
    return frames


class _Gone:
    """The only listener of a bus that is being left; it hears nothing, and takes the error by which its thread ends."""

    def __init__(self, notifier: Any) -> None:
        self._notifier = notifier

    def __call__(self, message: object) -> None:
        """Do nothing."""

    def on_error(self, error: Exception) -> None:
        """Forget the error, which would count as one of the bus."""
        self._notifier.exception = None


def leave(network: Any) -> None:
    """Disconnect canopen's network from its bus, without a wait if the bus lies within this process or machine.

    python-can's thread looks every `NOTIFIER_CYCLE` whether it shall stop. On its virtual bus anything that is put into
    the thread's queue wakes it. On a multicast socket it wakes when nothing can be received there any more.
    """
    notifier, received = network.notifier, getattr(network.bus, "queue", None)
    if notifier is not None and received is not None:
        _end(notifier)
        received.put(True)
    elif notifier is not None:
        with suppress(OSError, NotImplementedError), socket.socket(fileno=os.dup(network.bus.fileno())) as end:
            if end.family in OWN_GROUPS:
                _end(notifier)
                end.shutdown(socket.SHUT_RD)  # it wakes although it is refused, as no peer is connected
    network.disconnect()


def _end(notifier: Any) -> None:
    notifier.listeners[:] = [_Gone(notifier)]
    notifier._stopped = True


# -------------------------------------------------------------------------------------------------------
# Timing of a Modbus RTU line, which both of its ends need ("MODBUS over serial line" 1.02, 2.5.1.1)

SILENCE = 3.5  # number of characters' time that separates two frames
SHORTEST_SILENCE = 1.75e-3  # s, above 19200 bit/s
FASTEST = 4_000_000  # bit/s for pseudo-terminals, which have no real baud rate; the fastest one costs the least waiting
CLOCKS = 0.95  # two ends of a wire understand each other if their clocks differ by up to 5 %


def character_bits(parity: bool, stop_bits: int) -> int:
    """Number of bits of a character: start bit, eight data bits, parity bit, stop bits."""
    return 1 + 8 + parity + stop_bits


def silence(baudrate: float, bits: int) -> float:
    """Silence [s] that must separate two frames, so that devices know where the second begins."""
    return max(SILENCE * bits / baudrate, SHORTEST_SILENCE)


def reply_begins(size: int, baudrate: float, bits: int) -> float:
    """Time [s] from the first bit of a request of `size` bytes until a device that keeps the silence may reply."""
    return (size + SILENCE) * bits / baudrate


def earliest_reply(size: int, baudrate: float, bits: int) -> float:
    """Shortest time [s] from handing a request of `size` bytes to a port until a part of its reply can be read there.

    By then the request and one character of the reply must have been on the wire. An adapter that collects characters
    gives them later, and no adapter gives them sooner. The silence before a reply does not count, because some devices
    leave it out.
    """
    return CLOCKS * (size + 1) * bits / baudrate


# --- A simulated bench in this process that needs no thread --------------------------------------------


class Stepper(Protocol):
    """The other end of all links, where that lies in this process and answers only while this end steps it."""

    def step(self) -> None:
        """Let it answer all that it was asked, and let this end take it up; returns without waiting for more."""

    def ready(self, descriptor: int, within: float) -> bool:
        """Step until something can be read at a descriptor, for at most so long [s]; returns whether it can."""

    def glance(self, within: float) -> None:
        """Step if something comes, for which it waits a moment of at most so long [s]."""

    def take_turns(self, turn: Callable[[], bool]) -> None:
        """From now on call `turn` in each step, again and again until it returns that nothing was there."""

    def end_turns(self, turn: Callable[[], bool]) -> None:
        """Call `turn` no more."""

    def connected(self, port: str) -> socket.socket | None:
        """This end of a serial line that needs no terminal; None: the port is to be opened."""


# --- the links of a bench file -------------------------------------------------------------------------

LINE, CAN = "line", "can"  # links of a simulated bench that several devices share; faults strike them by these names
Timeout = Annotated[Seconds, Field(ge=1e-3, le=60)]


# a URL, or a host with a port; the host alone is a name, an IPv4 address, or an IPv6 address with colons of its own
URL = re.compile(r"([\w+.-]+://)?(?P<host>\[[^\]]+\]|[^:/\[\]\s]+)(:(?P<port>\d+))?(/.*)?")


def _alone(host: str) -> str:
    """A host as it is. Raises ValueError: it is a URL, or has a port."""
    found = URL.fullmatch(host)
    bare = found["host"].strip("[]") if found else host
    if found is None or bare == host:
        return host
    port = f" and port = {found['port']}" if found["port"] else ""
    raise ValueError(f'{host!r} is no host alone; write host = "{bare}"{port}')


Host = Annotated[str, Field(min_length=1), AfterValidator(_alone)]


class TcpLink(Config):
    """A Modbus TCP address, of one device or of a gateway with several units."""

    host: Host
    port: int = Field(default=502, ge=1, le=65535, strict=True)
    timeout: Timeout = 1.0


class SerialLine(Config):
    """A Modbus RTU line, which one or more devices share."""

    port: str = Field(min_length=1)
    baudrate: Baudrate = 115200
    parity: Literal["N", "E", "O"] = "N"
    stopbits: int = Field(default=1, ge=1, le=2, strict=True)
    timeout: Timeout = 1.0


class CanBus(Config):
    """A CAN bus."""

    interface: str = Field(min_length=1)
    channel: str
    bitrate: Bitrate = 1_000_000
    timeout: Timeout = 1.0


Link = TcpLink | SerialLine | CanBus
LINKS: dict[str, type[Link]] = {"modbus-tcp": TcpLink, "modbus-rtu": SerialLine, "canopen": CanBus}
KIND_OF = {model: kind for kind, model in LINKS.items()}


def link_of(table: dict[str, Any], where: str) -> Link:
    """The link of a `[link.NAME]` table. Raises ConfigError: the table is wrong."""
    kind = table.pop("kind", None)
    if kind not in LINKS:
        raise ConfigError(f"{where}: kind: {kind!r} is no kind of link; valid: {', '.join(LINKS)}")
    return check(table, LINKS[kind], where)


# --- frames as one thing -------------------------------------------------------------------------------


Octets = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """What nodes send at several SYNCs: at each of them one frame of each identifier, in the order of `columns`.

    Attributes:
        time_ns: times of the SYNCs on the bench's clock, shape (n,) [ns].
        columns: for each identifier the data of its frames, shape (n, bytes).
    """

    time_ns: npt.NDArray[np.int64]
    columns: Sequence[tuple[int, Octets]]

    def frames(self) -> Iterator[tuple[int, int, bytes]]:
        """Time [ns], identifier and data of each frame, in the order in which a bus carries them."""
        sent = [(cob_id, data.shape[1], data.tobytes()) for cob_id, data in self.columns]
        for number, time_ns in enumerate(self.time_ns.tolist()):
            for cob_id, size, data in sent:
                yield time_ns, cob_id, data[number * size : (number + 1) * size]


def take_blocks(received: Any) -> None:
    """Let senders put whole blocks into the queue of a receiver on python-can's virtual bus."""
    received.takes_blocks = True


def takes_blocks(received: Any) -> bool:
    """Whether the queue of a receiver takes whole blocks; others on the bus get frames one by one."""
    return getattr(received, "takes_blocks", False)


def time_of(frame: object) -> int | None:
    """Time of a frame on the bench's clock [ns]; None: its bus does not tell it, as one with a wire."""
    return getattr(frame, "time_ns", None)
