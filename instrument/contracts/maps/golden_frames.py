"""Golden frames: messages from a manual, by which a contract is proved.

A wrong scale, sign, order of bytes or address is wrong in driver and simulator alike, so that both agree. A frame that
somebody else has written tells.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import BITS, ONE_REGISTER, READS, Field
from palpate.instrument.contracts.maps.map_file import GoldenFrame, WireMessage
from palpate.instrument.errors import ConfigError, PalpateError, RangeError, UnknownName, named

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


# --- golden frames -------------------------------------------------------------------------------------


TOLERANCE = {"float32": 2.0**-22}  # relative; of other types a few roundings of a float64
ROUNDING = 1e-12


@dataclass(frozen=True)
class Proof:
    """What frames prove of a contract.

    Attributes:
        proved: for each field with a frame that fits, where its frames come from: `printed`, or `computed` alone.
        without: names of the fields without such a frame.
        problems: what does not fit, each with frame, field, and the values wanted and found.
    """

    proved: Mapping[str, str]
    without: tuple[str, ...]
    problems: tuple[str, ...]


def prove(contract: Contract, frames: Sequence[GoldenFrame]) -> Proof:
    """Prove a contract by frames: each is what our driver sends, and what it holds is decoded and encoded alike."""
    proved: dict[str, str] = {}
    problems: list[str] = []
    for frame in frames:
        try:
            fields = list(_checked(contract, frame))
        except (ConfigError, RangeError, UnknownName, struct.error, OverflowError, ValueError) as error:
            problems.append(f"{frame}: {error}")
            continue
        except KeyError as error:
            problems.append(f"{frame}: needs the value of {error.args[0]!r}; give it in `values` or `beside`")
            continue
        for name in fields:
            if frame.table.origin == "printed" or name not in proved:
                proved[name] = frame.table.origin
    without = tuple(f.name for f in contract.fields if f.name not in proved)
    return Proof(proved, without, tuple(problems))


def _checked(contract: Contract, frame: GoldenFrame) -> Iterator[str]:
    """The fields that a frame proves. Raises ConfigError: it does not fit."""
    values = _numbers(contract, frame)
    beside = {name: value for name, value in values.items() if not isinstance(value, str)} | frame.table.beside
    data = {name: _data(contract, name, value, beside, frame.does) for name, value in values.items()}
    if frame.does in ("sends", "takes"):
        held = _pdo(contract, frame)
    elif contract.bus == "modbus":
        held = _modbus(contract, frame, data)
    else:
        held = _sdo(contract, frame, data)
    for name in values:
        if name in held:
            _compare(contract, name, values[name], held[name], data[name], beside)
            yield name


def _numbers(contract: Contract, frame: GoldenFrame) -> dict[str, float | str]:
    """Physical value of each field of a frame; of a text field its text. Raises ConfigError, UnknownName."""
    given: dict[str, Any] = dict(frame.table.values)
    names = frame.names
    if frame.does == "command":
        command = named("command", frame.names[0], {each.name: each for each in contract.commands})
        names, given = (command.field,), {command.field: command.value, **given}
    elif frame.does in ("sends", "takes"):
        pdo = contract.sent(frame.names[0]) if frame.does == "sends" else contract.taken(frame.names[0])
        names = pdo.fields
    if set(given) != set(names):
        raise ConfigError(f"has values of {', '.join(given) or 'nothing'}; give those of {', '.join(names)}")
    return {name: _number(contract, name, given[name]) for name in names}


def _number(contract: Contract, name: str, value: Any) -> float | str:
    f = contract[name]
    if f.type == "text":
        if not isinstance(value, str):
            raise ConfigError(f"{name} = {value!r} is no text")
        return value
    if isinstance(value, tuple):
        return float(sum(1 << named(f"bit of {name}", bit, f.bits) for bit in set(value)))
    return contract.raw(name, value) * f.scale + f.offset if isinstance(value, str) else value


def _data(contract: Contract, name: str, value: float | str, beside: Mapping[str, float], does: str) -> bytes:
    """Wire bytes of a field. Raises ConfigError, RangeError: the contract does not allow the value."""
    f = contract[name]
    if does in ("read", "sends") and f.access == "wo":
        raise ConfigError(f"{name} cannot be read; its access is {f.access!r}")
    if does in ("write", "command", "takes") and f.access == "ro":
        raise ConfigError(f"{name} cannot be written; its access is {f.access!r}")
    if isinstance(value, str):
        return contract.encode_text(name, value)
    if does in ("write", "command", "takes"):
        return contract.encode(name, value, beside)
    if math.isnan(value) and not f.missing and not f.type.startswith("float"):
        raise ConfigError(f"{name} = nan, but it has no raw value that says so; give a number, or its key `missing`")
    if fault := contract.misread(name, value):
        raise ConfigError(fault)
    return contract.pack(name, value, beside)


def _compare(
    contract: Contract, name: str, value: float | str, held: bytes, data: bytes, beside: Mapping[str, float]
) -> None:
    """Raises ConfigError: the bytes of a frame are not those of the value, or the value is not that of the bytes."""
    f = contract[name]
    if isinstance(value, str):
        found: float | str = contract.decode_text(name, held)
        same = found == value
    else:
        if len(held) != f.size:
            raise ConfigError(f"{name}: {len(held)} bytes, a {f.type} has {f.size}")
        found = contract.decode(name, held, beside)
        used = used_bits(f) if contract.bus == "modbus" else b"\xff" * f.size
        bytes_alike = all((one ^ other) & mask == 0 for one, other, mask in zip(held, data, used, strict=True))
        close = math.isclose(
            found, value, rel_tol=TOLERANCE.get(f.type, ROUNDING), abs_tol=ROUNDING * max(abs(f.scale), abs(f.offset))
        )
        same = (bytes_alike and close) or (math.isnan(found) and math.isnan(value))
    if not same:
        raise ConfigError(
            f"{name}: {_shown(value)} {f.unit}".rstrip() + f" wanted ({data.hex(' ').upper()}), {_shown(found)} found "
            f"({held.hex(' ').upper()})"
        )


def _shown(value: float | str) -> str:
    return repr(value) if isinstance(value, str) else f"{value:.12g}"


def _only(frame: GoldenFrame, which: str, messages: Sequence[WireMessage], can: bool) -> Sequence[WireMessage]:
    """The messages. Raises ConfigError: there is none, or one is not of this bus."""
    if not messages:
        raise ConfigError(f"has no {which}; give it")
    for each in messages:
        if (each.cob_id is not None) != can:
            raise ConfigError(f"{which} {each} must be {'a CAN frame, as 601: 40 30' if can else 'bytes'}")
    return messages


def _modbus(contract: Contract, frame: GoldenFrame, data: Mapping[str, bytes]) -> Mapping[str, bytes]:
    """The bytes of each field of a frame. Raises ConfigError: it is not what our driver sends, or no reply to that."""
    request = _only(frame, "request", frame.table.request, can=False)[0].data
    unit, pdu = _split("request", request)
    reading = frame.does == "read"
    wanted = (read_request if reading else write_request)(contract, data)
    head = len(pdu) if reading else head_of(wanted)
    if len(pdu) != len(wanted) or pdu[:head] != wanted[:head]:
        raise ConfigError(
            f"{', '.join(data)}: request {WireMessage(request)}, our driver sends "
            f"{WireMessage(framed(unit, wanted))}{_elsewhere(contract, data, pdu[:head], wanted[:head])}"
        )
    if not frame.table.reply and not reading:
        return held_by(contract, tuple(data), written(pdu))
    reply = _only(frame, "reply", frame.table.reply, can=False)[0].data
    answering, answer = _split("reply", reply)
    if answering != unit:
        raise ConfigError(f"reply {WireMessage(reply)} is from unit {answering}, not from {unit}")
    if reading:
        return held_by(contract, tuple(data), replied(contract, tuple(data), answer))
    confirmed = write_reply(pdu)
    if answer != confirmed and not is_refusal(pdu, answer):
        raise ConfigError(f"reply {WireMessage(reply)}, must be {WireMessage(framed(unit, confirmed))}")
    return held_by(contract, tuple(data), written(pdu))


def _elsewhere(contract: Contract, names: Iterable[str], given: bytes, wanted: bytes) -> str:
    """Text that says at which addresses the fields of a request would fit it; empty: not the addresses alone differ."""
    if len(given) != len(wanted) or (given[:1], given[3:]) != (wanted[:1], wanted[3:]):
        return ""
    moved = int.from_bytes(given[1:3], "big") - int.from_bytes(wanted[1:3], "big")
    fits = [f"address = {contract[name].address + moved}" for name in names]
    return f"; would fit with {', '.join(fits)}"


def _split(which: str, frame: bytes) -> tuple[int, bytes]:
    try:
        return split(frame)
    except ConfigError as error:
        raise ConfigError(f"{which} {WireMessage(frame)} {error}") from None


def _sdo(contract: Contract, frame: GoldenFrame, data: Mapping[str, bytes]) -> Mapping[str, bytes]:
    """As `_modbus`, for an SDO transfer."""
    if len(data) != 1:
        raise ConfigError(f"is about {', '.join(data)}; a transfer reads or writes one object")
    ((name, value),) = data.items()
    f, reading = contract[name], frame.does == "read"
    requests, answers = (upload if reading else download)(f, value)
    asked = _only(frame, "request", frame.table.request, can=True)
    node = (asked[0].cob_id or 0) - REQUESTS
    if node not in NODES:
        raise ConfigError(f"request {asked[0]} is to no node; its COB-ID is 600h and a node id of 1 to 127")
    if reading:
        held = uploaded(f, [each.data for each in _only(frame, "reply", frame.table.reply, can=True)])
    else:
        held = downloaded(f, [each.data for each in asked])
    if held != value:  # the difference of values says more than that of frames
        return {name: held}
    _same_frames(name, "request", asked, requests, REQUESTS + node)
    if frame.table.reply and not (len(frame.table.reply) == 1 and aborted(f, frame.table.reply[0].data)):
        _same_frames(name, "reply", frame.table.reply, answers, ANSWERS + node)
    return {name: held}


def _same_frames(name: str, which: str, given: Sequence[WireMessage], wanted: Sequence[bytes], cob_id: int) -> None:
    """Raises ConfigError: frames of a transfer are others than these."""
    same = len(given) == len(wanted) and all(
        each.cob_id == cob_id and alike(each.data, data) for each, data in zip(given, wanted, strict=True)
    )
    if not same:
        raise ConfigError(
            f"{name}: {which} {', '.join(map(str, given))}; must be "
            + ", ".join(str(WireMessage(data, cob_id)) for data in wanted)
        )


def _pdo(contract: Contract, frame: GoldenFrame) -> Mapping[str, bytes]:
    """The bytes of each field of a PDO. Raises ConfigError: the frame cannot be that PDO of any node."""
    sends = frame.does == "sends"
    pdo = (contract.sent if sends else contract.taken)(frame.names[0])
    which, messages = ("reply", frame.table.reply) if sends else ("request", frame.table.request)
    message = _only(frame, which, messages, can=True)[0]
    if not pdo.node_of(message.cob_id or 0):
        whose = pdo.node or "of 1 to 127"
        raise ConfigError(f"{which} {message}: the COB-ID of {pdo.name} is {pdo.base:X}h and a node id {whose}")
    size = sum(contract[name].size for name in pdo.fields)
    if len(message.data) != size:
        raise ConfigError(f"{which} {message}: {len(message.data)} bytes, {pdo.name} has {size}")
    return contract.parts(pdo, message.data)


# --- frames that are worked out from a map, for its author to check against the manual and to paste into it

UNIT = 1  # Modbus unit id, or node id, of the frames
SHARE = 0.3  # of its range: where a value without a default is taken from


def computed(contract: Contract, names: tuple[str, ...]) -> Iterator[str]:
    """A table `[[frame]]` for each of these fields, with a value of its range."""
    for name in names:
        try:
            yield _frame_table(contract, contract[name])
        except (PalpateError, struct.error, ArithmeticError, KeyError) as error:
            yield f"# {name}: no frame can be worked out: {' '.join(str(error).split())}\n"


def _frame_table(contract: Contract, f: Field) -> str:
    reading = f.access != "wo"
    beside = {name: _example_number(contract[name]) for name in f.beside}
    value = _example(f)
    if isinstance(value, str) and f.type == "text":
        data = value.encode() if contract.bus == "canopen" else contract.encode_text(f.name, value)
    elif reading:
        number = contract.raw(f.name, value) * f.scale + f.offset if isinstance(value, str) else value
        number = sum(1 << f.bits[bit] for bit in number) if isinstance(number, list) else number
        data = contract.pack(f.name, number, beside)
        value = value if isinstance(value, (str, list)) else contract.decode(f.name, data, beside)
    else:
        data = contract.encode(f.name, sum(1 << f.bits[b] for b in value) if isinstance(value, list) else value, beside)
    request, reply = _exchange(contract, f, data, reading)
    lines = ["[[frame]]", f'says = "{"read" if reading else "write"} {f.name}"']
    lines += [f"request = {_texts(request)}", f"reply = {_texts(reply)}", f"values = {_inline({f.name: value})}"]
    if beside:
        lines.append(f"beside = {_inline(beside)}")
    return "\n".join([*lines, 'origin = "computed"']) + "\n"


def _example(f: Field) -> Any:
    if f.type == "text":
        return "AB12"[: f.length] if f.length else "AB12"
    if f.bits:
        return [next(iter(f.bits))]
    if f.choices:
        return list(f.choices)[-1]
    return _example_number(f)


def _example_number(f: Field) -> float:
    """A value within the limits, which is no round one, so that an exchanged order of bytes shows."""
    if f.choices:
        return float(list(f.choices.values())[-1])
    bits = f.part[1] if f.part else 8 * f.size
    raw = {1: 1, 8: 0x12}.get(bits, 0x1234 & (1 << bits) - 1) if bits < 24 else 0x12345
    value = f.scale * raw + f.offset
    low, high = f.limits
    if low <= value <= high:
        return value
    if math.isinf(low) or math.isinf(high):
        return high if math.isinf(low) else low
    return f.scale * round((low + SHARE * (high - low) - f.offset) / f.scale) + f.offset


def _exchange(contract: Contract, f: Field, data: bytes, reading: bool) -> tuple[list[WireMessage], list[WireMessage]]:
    if contract.bus == "canopen":
        asked, answered = (upload if reading else download)(f, data)
        return (
            [WireMessage(each, REQUESTS + UNIT) for each in asked],
            [WireMessage(each, ANSWERS + UNIT) for each in answered],
        )
    held = {f.name: data}
    asking = read_request(contract, held) if reading else write_request(contract, held)
    answer = read_reply(contract, held) if reading else write_reply(asking)
    unit = max(UNIT, contract.manners.units[0]) if contract.manners.units[1] else 0
    return [WireMessage(framed(unit, asking))], [WireMessage(framed(unit, answer))]


def _texts(messages: list[WireMessage]) -> str:
    texts = [f'"{message}"' for message in messages]
    return texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]"


def _inline(values: Mapping[str, Any]) -> str:
    return "{ " + ", ".join(f"{name} = {_literal(value)}" for name, value in values.items()) + " }"


def _literal(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_literal(each) for each in value)}]"
    if isinstance(value, str):
        return f'"{value}"'
    return str(int(value)) if value == int(value) else repr(value)
