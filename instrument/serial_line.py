"""What a Modbus RTU line does to time, as both of its ends need it ("MODBUS over serial line" 1.02, 2.5.1.1)."""

from __future__ import annotations

SILENCE = 3.5  # characters that keep frames apart
SHORTEST_SILENCE = 1.75e-3  # s, above 19200 bit/s
FASTEST = 4_000_000  # bit/s; a pseudo-terminal is no wire and keeps no baud rate, this one costs the least


def character_bits(parity: bool, stop_bits: int) -> int:
    """Bits of a character: start, eight, parity, stop."""
    return 1 + 8 + parity + stop_bits


def reply_begins(size: int, baudrate: float, bits: int) -> float:
    """How soon after the first bit of a request of `size` bytes its reply can begin [s].

    Nothing that comes sooner can be the reply: the request is not sent whole, or nobody knows yet that it has ended.
    """
    return (size + SILENCE) * bits / baudrate
