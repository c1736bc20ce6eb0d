"""Frames of Modbus RTU and of SDO transfers (CiA 301), as our driver sends them and a device answers."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import BITS, ONE_REGISTER, READS, Field
from palpate.instrument.errors import ConfigError

# --- Modbus RTU ------------------------------------------------------------------------------------------

ONE_COIL, COILS = 5, 15  # function codes
ON = b"\xff\x00"  # of a coil, in a request of function 5
EXCEPTION = 0x80  # the bit of a function code that marks a refusal
LEAST = 4  # bytes of a frame: unit, function and CRC


def crc(data: bytes) -> bytes:
    """CRC-16 of a frame ("MODBUS over serial line" 1.02, 6.2.2), low byte first as on the line."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 if value & 1 else value >> 1
    return value.to_bytes(2, "little")


def framed(unit: int, pdu: bytes) -> bytes:
    """A frame of a request or reply to or from a unit."""
    body = bytes([unit]) + pdu
    return body + crc(body)


def split(frame: bytes) -> tuple[int, bytes]:
    """Unit and PDU of a frame. Raises ConfigError: it is too short, or its CRC is wrong."""
    if len(frame) < LEAST:
        raise ConfigError(f"has {len(frame)} bytes; a frame has {LEAST} or more")
    if (wanted := crc(frame[:-2])) != frame[-2:]:
        raise ConfigError(f"ends with the CRC {frame[-2:].hex(' ').upper()}, must be {wanted.hex(' ').upper()}")
    return frame[0], frame[1:-2]


def read_request(contract: Contract, names: Collection[str]) -> bytes:
    """PDU that reads fields in one request. Raises ConfigError: they are in different tables."""
    start, count = contract.block(names)
    function = READS[_table(contract, names).table]
    return bytes([function]) + start.to_bytes(2, "big") + count.to_bytes(2, "big")


def _table(contract: Contract, names: Collection[str]) -> Field:
    """The first field, if all are in its table. Raises ConfigError."""
    fields = [contract[name] for name in names]
    if len({f.table for f in fields}) > 1:
        raise ConfigError(f"{', '.join(names)} are in different tables, which one request cannot reach")
    return fields[0]


def read_reply(contract: Contract, data: Mapping[str, bytes], around: bytes = b"") -> bytes:
    """PDU of the reply to a read of fields with these bytes.

    Args:
        contract: the contract.
        data: bytes of each field.
        around: data of a reply, from which bits come that belong to none of the fields.
    """
    start, count = contract.block(data)
    first = _table(contract, tuple(data))
    held = _merged(contract, data, start, count, around)
    return bytes([READS[first.table], len(held)]) + held


def write_request(contract: Contract, data: Mapping[str, bytes]) -> bytes:
    """PDU that writes fields in one request. Raises ConfigError: no request can write them at once."""
    start, count = contract.block(data)
    first = _table(contract, tuple(data))
    place = start.to_bytes(2, "big")
    functions = {contract[name].writes for name in data}
    function = first.writes if len(functions) == 1 else 0
    if first.table in BITS and len(data) > 1:
        function = COILS
    if not function or sum(contract[name].width for name in data if contract[name].part is None) not in (0, count):
        raise ConfigError(f"{', '.join(data)} cannot be written by one request: they have gaps or other functions")
    held = _merged(contract, data, start, count)
    if function == ONE_COIL:
        return bytes([function]) + place + (ON if held[0] else bytes(2))
    if function == ONE_REGISTER:
        return bytes([function]) + place + held
    return bytes([function]) + place + count.to_bytes(2, "big") + bytes([len(held)]) + held


def write_reply(request: bytes) -> bytes:
    """PDU that confirms a write."""
    return request if request[0] in (ONE_COIL, ONE_REGISTER) else request[:5]


def is_refusal(request: bytes, reply: bytes) -> bool:
    """Whether a reply is an exception response to this request."""
    return len(reply) == 2 and reply[0] == request[0] | EXCEPTION


def _merged(contract: Contract, data: Mapping[str, bytes], start: int, count: int, around: bytes = b"") -> bytes:
    """Data of a block of registers or bits."""
    bits = contract[next(iter(data))].table in BITS
    size = (count + 7) // 8 if bits else 2 * count
    held = bytearray(around if len(around) == size else bytes(size))
    for name, value in data.items():
        f = contract[name]
        at = f.address - start
        if bits:
            held[at // 8] = held[at // 8] & ~(1 << at % 8) | (value[0] & 1) << at % 8
            continue
        mask, here = used_bits(f), slice(2 * at, 2 * at + f.size)
        kept = bytes(old & ~used | new & used for old, used, new in zip(held[here], mask, value, strict=True))
        held[here] = kept
    return bytes(held)


def used_bits(f: Field) -> bytes:
    """The bits of its registers that belong to a field."""
    if f.part is None:
        return b"\xff" * f.size
    first, count = f.part
    return ((1 << count) - 1 << first).to_bytes(2, "big" if f.octets == "big" else "little")


def head_of(write: bytes) -> int:
    """Number of bytes of a write request before its data."""
    return 3 if write[0] in (ONE_COIL, ONE_REGISTER) else 6


def written(write: bytes) -> bytes:
    """The data of a write request."""
    data = write[head_of(write) :]
    return bytes([data == ON]) if write[0] == ONE_COIL else data


def replied(contract: Contract, names: Sequence[str], reply: bytes) -> bytes:
    """The data in the reply to a read of these fields. Raises ConfigError: it is no such reply."""
    _, count = contract.block(names)
    first = _table(contract, names)
    size = (count + 7) // 8 if first.table in BITS else 2 * count
    head = bytes([READS[first.table], size])
    if reply[:2] != head or len(reply) != 2 + size:
        raise ConfigError(
            f"{', '.join(names)}: reply begins with {reply[:2].hex(' ').upper()} and holds {len(reply) - 2} bytes; "
            f"must begin with {head.hex(' ').upper()} and hold {size}"
        )
    return reply[2:]


def held_by(contract: Contract, names: Sequence[str], data: bytes) -> dict[str, bytes]:
    """The bytes of each field in the data of a request or reply that holds just these fields."""
    start, _ = contract.block(names)
    found = {}
    for name in names:
        f = contract[name]
        at = f.address - start
        found[name] = bytes([data[at // 8] >> at % 8 & 1]) if f.table in BITS else data[2 * at : 2 * at + f.size]
    return found


# --- SDO transfers ---------------------------------------------------------------------------------------

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
