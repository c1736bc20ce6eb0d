"""What a Modbus RTU line does to time, as both of its ends need it ("MODBUS over serial line" 1.02, 2.5.1.1)."""

from __future__ import annotations

SILENCE = 3.5  # characters that keep frames apart
SHORTEST_SILENCE = 1.75e-3  # s, above 19200 bit/s
FASTEST = 4_000_000  # bit/s; a pseudo-terminal is no wire and keeps no baud rate, this one costs the least
CLOCKS = 0.95  # two ends of a wire understand each other if their clocks differ by up to 5 %


def character_bits(parity: bool, stop_bits: int) -> int:
    """Bits of a character: start, eight, parity, stop."""
    return 1 + 8 + parity + stop_bits


def reply_begins(size: int, baudrate: float, bits: int) -> float:
    """How soon after the first bit of a request of `size` bytes a device that keeps the silence begins to reply [s]."""
    return (size + SILENCE) * bits / baudrate


def earliest_reply(size: int, baudrate: float, bits: int) -> float:
    """How soon after a request of `size` bytes is handed to a port something of its reply can be read there [s].

    By then the request and one character of the reply have been on the wire, whatever adapter stands at its end: one
    that collects characters gives them later, none gives them sooner. The silence before a reply does not count, as
    there are devices that leave it out.
    """
    return CLOCKS * (size + 1) * bits / baudrate
