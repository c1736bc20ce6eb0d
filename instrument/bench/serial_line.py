"""Timing of a Modbus RTU line, which both of its ends need ("MODBUS over serial line" 1.02, 2.5.1.1)."""

from __future__ import annotations

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
