"""Protocols for what may stand between the two ends of a link and damage frames; the faults implement them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, Protocol

Send = Callable[[Any], None]  # sends one frame, a `can.Message`


class StoppableServer(Protocol):
    """The server of a device, as far as a relay can stop and start it."""

    def stop_listening(self) -> None: ...

    def listen_again(self) -> None:
        """Listen again without waiting for another thread: the servers' thread may itself be waiting for the clock."""


class Damage(Protocol):
    """What a fault does to one request and its reply.

    Attributes:
        forwards: whether the request reaches the device.
        holds: whether the reply is held back until the next request comes.
        then: what becomes of the connection: it stays, is reset, or is reset and new ones are refused.
        lasts_ns: how long new connections are refused [ns].
    """

    @property
    def forwards(self) -> bool: ...
    @property
    def holds(self) -> bool: ...
    @property
    def then(self) -> Literal["goes on", "reset", "refused"]: ...
    @property
    def lasts_ns(self) -> int: ...

    def segments(self, request: bytes, reply: bytes) -> list[bytes]:
        """The pieces in which the damaged reply is sent. `reply` is empty if the request was not forwarded."""


class Relay(Protocol):
    """Stands between a Modbus TCP server and its clients."""

    def struck(self) -> Damage | None:
        """The damage to the present request; None: it passes unharmed."""

    def refuse(self, server: StoppableServer, lasts_ns: int) -> None:
        """Let a server stop listening for a time [ns]; 0: until the clock moves on."""


class LineNoise(Protocol):
    """Passes frames on between the two ends of a serial line, and may damage them."""

    def watch(self, client: int) -> None:
        """Put the client's terminal into the mode in which the first byte read from it tells that it was reopened."""

    def to_device(self, client: int, heard: bytes) -> bytes:
        """The bytes that the device receives, from those that were read from the client's terminal."""

    def to_client(self, frame: bytes) -> bytes:
        """The bytes that the client receives, from those that a device has written."""
