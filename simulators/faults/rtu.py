"""Faults of the Modbus RTU line: noise and slow devices change its frames.

A frame is unit, function, data and two bytes of CRC; a pause ends it.
"""

from __future__ import annotations

import fcntl
import os
import struct
import termios
from collections.abc import Sequence
from typing import ClassVar

from palpate.instrument.bench.links import LINE
from palpate.simulators.clock import VirtualClock
from palpate.simulators.faults.fault import Fault, Trigger
from palpate.simulators.faults.places import Target

GLITCH = b"\x00\xff\xf8"  # spurious bytes that a client reads when a device begins to drive the line


class RtuFault(Fault):
    """Changes what the client gets as a reply."""

    targets: ClassVar[tuple[Target, ...]] = (LINE, "modbus-rtu")
    late: ClassVar[bool] = False  # whether the reply comes after the client's time-out
    reaches: ClassVar[bool] = True  # whether the device hears the request

    def received(self, reply: bytes) -> bytes:
        return b""


class BitError(RtuFault):
    """One bit is inverted, so that the CRC does not fit."""

    def received(self, reply: bytes) -> bytes:
        middle = len(reply) // 2
        return reply[:middle] + bytes([reply[middle] ^ 0x08]) + reply[middle + 1 :]


class LostBytes(RtuFault):
    """Two bytes in the middle are missing."""

    def received(self, reply: bytes) -> bytes:
        middle = len(reply) // 2
        return reply[: middle - 1] + reply[middle + 1 :]


class LeadingGlitch(RtuFault):
    """A glitch comes before the reply, when the device begins to drive the line."""

    def received(self, reply: bytes) -> bytes:
        return GLITCH + reply


class LateAnswer(RtuFault):
    """The reply comes after the client's time-out, and would look like the answer to its next request."""

    late: ClassVar[bool] = True


class TwoReplies(RtuFault):
    """The reply comes twice."""

    def received(self, reply: bytes) -> bytes:
        return reply + reply


class Silence(RtuFault):
    """The device does not hear the request."""

    reaches: ClassVar[bool] = False


class NoisyLine:
    """Carries frames between the two ends of a line, with faults. `units` holds the devices' names by unit."""

    def __init__(self, clock: VirtualClock, faults: Sequence[tuple[RtuFault, Trigger]], units: dict[int, str]) -> None:
        self._clock = clock
        self._faults = faults
        self._units = units
        self._struck: RtuFault | None = None
        self._late = b""

    def watch(self, client: int) -> None:
        """Set the client's terminal to tell when it is opened anew, in the first byte of what is read from it."""
        fcntl.ioctl(client, termios.TIOCPKT, struct.pack("i", 1))

    def to_device(self, client: int, told: bytes) -> bytes:
        """The bytes that the device receives, from those that were read from the client's terminal.

        The client writes a whole frame at once. A client that has given up opens the line anew and clears it; late
        replies come then.
        """
        frame = told[1:]
        if self._late and told[0] & termios.TIOCPKT_FLUSHREAD:
            os.write(client, self._late)
            self._late = b""
        if not frame:
            return b""
        self._struck = self._strikes(self._units.get(frame[0], ""))
        return frame if self._struck is None or self._struck.reaches else b""

    def to_client(self, frame: bytes) -> bytes:
        """The bytes that the client receives, from those that a device has written."""
        struck, self._struck = self._struck, None
        if struck is None:
            return frame
        if struck.late:
            self._late = frame
            return b""
        return struck.received(frame)

    def _strikes(self, device: str) -> RtuFault | None:
        now = self._clock.now_ns()
        of_it = [(fault, trigger) for fault, trigger in self._faults if fault.on in (LINE, device)]
        struck = [fault for fault, trigger in of_it if trigger.strikes(now)]
        return struck[0] if struck else None
