"""What may stand between the two ends of a link: the wire knows these protocols, and not who damages its frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, Protocol

Send = Callable[[Any], None]  # of a frame, which is python-can's message already


class Listener(Protocol):
    """The server of a device, which a relay may stop and start."""

    def stop_listening(self) -> None: ...

    def listen_again(self) -> None:
        """Listen again at once, without waiting for any thread: the servers' thread may be waiting for the clock."""


class Damage(Protocol):
    """What becomes of one request and its reply.

    Attributes:
        forwards: whether the request reaches the device.
        holds: whether the reply is kept until the next request comes.
        then: what becomes of the connection.
        lasts_ns: how long it goes on.
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
        """What is sent, piece by piece. `reply` is empty where the request was not forwarded."""


class Relay(Protocol):
    """Stands between a Modbus TCP server and its clients."""

    def struck(self) -> Damage | None:
        """What becomes of the present request; None: it passes."""

    def refuse(self, server: Listener, lasts_ns: int) -> None:
        """Stop listening for a time, or until the clock goes on."""


class Noise(Protocol):
    """What passes frames on between the two ends of a line."""

    def watch(self, client: int) -> None:
        """Let the client's terminal tell when it is opened anew, in the first byte of what is read from it."""

    def to_device(self, client: int, told: bytes) -> bytes:
        """What the device hears of the bytes that were read from the client's terminal."""

    def to_client(self, frame: bytes) -> bytes:
        """What the client hears of the bytes that a device has written."""
