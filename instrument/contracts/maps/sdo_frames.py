"""Frames of SDO transfers (CiA 301) that read or write objects, as our driver sends them and a node answers."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.instrument.contracts.field import Field
from palpate.instrument.errors import ConfigError

REQUESTS, ANSWERS = 0x600, 0x580  # COB-IDs are these and the node id
NODES = range(1, 128)
SIZE = 8  # bytes of a frame
EXPEDITED, SEGMENT = 4, 7  # most bytes of an object in a frame
SIZE_TOLD = 0x01  # bit of an expedited transfer that tells its size
READ, GIVEN, GIVEN_LONG = 0x40, 0x43, 0x41
WRITE, WRITE_LONG, TAKEN = 0x23, 0x21, 0x60
NEXT, NEXT_TAKEN, TOGGLE, LAST = 0x60, 0x20, 0x10, 0x01
ABORT = 0x80

Frames = list[bytes]


def _head(specifier: int, f: Field, data: bytes = b"") -> bytes:
    return (bytes([specifier]) + f.index.to_bytes(2, "little") + bytes([f.subindex]) + data).ljust(SIZE, b"\0")


def _expedited(specifier: int, f: Field, data: bytes) -> bytes:
    return _head(specifier | EXPEDITED - len(data) << 2, f, data)


def _segments(data: bytes) -> Frames:
    """Frames of a long object, each with its toggle bit, the last with its mark."""
    parts = [data[at : at + SEGMENT] for at in range(0, len(data), SEGMENT)]
    last = len(parts) - 1
    return [
        (bytes([(number % 2) * TOGGLE | SEGMENT - len(part) << 1 | (number == last) * LAST]) + part).ljust(SIZE, b"\0")
        for number, part in enumerate(parts)
    ]


def _toggled(specifier: int, count: int) -> Frames:
    return [bytes([specifier | (number % 2) * TOGGLE]).ljust(SIZE, b"\0") for number in range(count)]


def upload(f: Field, data: bytes) -> tuple[Frames, Frames]:
    """Requests that read an object, and the answers that give these bytes."""
    if 0 < len(data) <= EXPEDITED:
        return [_head(READ, f)], [_expedited(GIVEN, f, data)]
    parts = _segments(data)
    return (
        [_head(READ, f), *_toggled(NEXT, len(parts))],
        [_head(GIVEN_LONG, f, len(data).to_bytes(4, "little")), *parts],
    )


def download(f: Field, data: bytes) -> tuple[Frames, Frames]:
    """Requests that write these bytes to an object, and the answers that confirm them."""
    if 0 < len(data) <= EXPEDITED:
        return [_expedited(WRITE, f, data)], [_head(TAKEN, f)]
    parts = _segments(data)
    return (
        [_head(WRITE_LONG, f, len(data).to_bytes(4, "little")), *parts],
        [_head(TAKEN, f), *_toggled(NEXT_TAKEN, len(parts))],
    )


def uploaded(f: Field, answers: Sequence[bytes]) -> bytes:
    """The bytes of an object that answers give. Raises ConfigError: they are no answers to its read."""
    first = answers[0]
    if first[1:4] != _head(0, f)[1:4] or first[0] & ~0x0F != READ:
        raise ConfigError(f"reply {first.hex(' ').upper()} is no answer to a read of {f.index:04X}:{f.subindex:X}")
    return _content(f, first, answers)


def downloaded(f: Field, requests: Sequence[bytes]) -> bytes:
    """The bytes of an object that requests give. Raises ConfigError: they do not write it."""
    first = requests[0]
    if first[1:4] != _head(0, f)[1:4] or first[0] & ~0x0F != WRITE & ~0x0F:
        raise ConfigError(f"request {first.hex(' ').upper()} does not write {f.index:04X}:{f.subindex:X}")
    return _content(f, first, requests)


def _content(f: Field, first: bytes, frames: Sequence[bytes]) -> bytes:
    if first[0] & 0x02:
        size = EXPEDITED - (first[0] >> 2 & 3) if first[0] & SIZE_TOLD else min(f.size or EXPEDITED, EXPEDITED)
        return first[4 : 4 + size]
    return b"".join(each[1 : SIZE - (each[0] >> 1 & 7)] for each in frames[1:])


def alike(given: bytes, wanted: bytes) -> bool:
    """Whether two frames say the same: an expedited transfer of four bytes may leave out that it has four."""
    full = wanted[0] in (GIVEN, WRITE) and given[0] == wanted[0] & ~SIZE_TOLD
    return given == wanted or (full and given[1:] == wanted[1:])


def aborted(f: Field, answer: bytes) -> bool:
    """Whether an answer says that the node refuses the transfer."""
    return answer[:4] == _head(ABORT, f)[:4]
