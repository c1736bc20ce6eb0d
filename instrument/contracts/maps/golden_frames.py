"""Golden frames: messages from a manual, by which a contract is proved.

A wrong scale, sign, order of bytes or address is wrong in driver and simulator alike, so that both agree. A frame that
somebody else has written tells.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from palpate.instrument.contracts.contract import Contract, Field
from palpate.instrument.contracts.maps import frames
from palpate.instrument.contracts.maps.map_file import GoldenFrame, WireMessage
from palpate.instrument.errors import ConfigError, PalpateError, RangeError, UnknownName, named

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
        used = frames.used_bits(f) if contract.bus == "modbus" else b"\xff" * f.size
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
    wanted = (frames.read_request if reading else frames.write_request)(contract, data)
    head = len(pdu) if reading else frames.head_of(wanted)
    if len(pdu) != len(wanted) or pdu[:head] != wanted[:head]:
        raise ConfigError(
            f"{', '.join(data)}: request {WireMessage(request)}, our driver sends "
            f"{WireMessage(frames.framed(unit, wanted))}{_elsewhere(contract, data, pdu[:head], wanted[:head])}"
        )
    if not frame.table.reply and not reading:
        return frames.held_by(contract, tuple(data), frames.written(pdu))
    reply = _only(frame, "reply", frame.table.reply, can=False)[0].data
    answering, answer = _split("reply", reply)
    if answering != unit:
        raise ConfigError(f"reply {WireMessage(reply)} is from unit {answering}, not from {unit}")
    if reading:
        return frames.held_by(contract, tuple(data), frames.replied(contract, tuple(data), answer))
    confirmed = frames.write_reply(pdu)
    if answer != confirmed and not frames.is_refusal(pdu, answer):
        raise ConfigError(f"reply {WireMessage(reply)}, must be {WireMessage(frames.framed(unit, confirmed))}")
    return frames.held_by(contract, tuple(data), frames.written(pdu))


def _elsewhere(contract: Contract, names: Iterable[str], given: bytes, wanted: bytes) -> str:
    """Text that says at which addresses the fields of a request would fit it; empty: not the addresses alone differ."""
    if len(given) != len(wanted) or (given[:1], given[3:]) != (wanted[:1], wanted[3:]):
        return ""
    moved = int.from_bytes(given[1:3], "big") - int.from_bytes(wanted[1:3], "big")
    fits = [f"address = {contract[name].address + moved}" for name in names]
    return f"; would fit with {', '.join(fits)}"


def _split(which: str, frame: bytes) -> tuple[int, bytes]:
    try:
        return frames.split(frame)
    except ConfigError as error:
        raise ConfigError(f"{which} {WireMessage(frame)} {error}") from None


def _sdo(contract: Contract, frame: GoldenFrame, data: Mapping[str, bytes]) -> Mapping[str, bytes]:
    """As `_modbus`, for an SDO transfer."""
    if len(data) != 1:
        raise ConfigError(f"is about {', '.join(data)}; a transfer reads or writes one object")
    ((name, value),) = data.items()
    f, reading = contract[name], frame.does == "read"
    requests, answers = (frames.upload if reading else frames.download)(f, value)
    asked = _only(frame, "request", frame.table.request, can=True)
    node = (asked[0].cob_id or 0) - frames.REQUESTS
    if node not in frames.NODES:
        raise ConfigError(f"request {asked[0]} is to no node; its COB-ID is 600h and a node id of 1 to 127")
    if reading:
        held = frames.uploaded(f, [each.data for each in _only(frame, "reply", frame.table.reply, can=True)])
    else:
        held = frames.downloaded(f, [each.data for each in asked])
    if held != value:  # the difference of values says more than that of frames
        return {name: held}
    _same_frames(name, "request", asked, requests, frames.REQUESTS + node)
    if frame.table.reply and not (len(frame.table.reply) == 1 and frames.aborted(f, frame.table.reply[0].data)):
        _same_frames(name, "reply", frame.table.reply, answers, frames.ANSWERS + node)
    return {name: held}


def _same_frames(name: str, which: str, given: Sequence[WireMessage], wanted: Sequence[bytes], cob_id: int) -> None:
    """Raises ConfigError: frames of a transfer are others than these."""
    same = len(given) == len(wanted) and all(
        each.cob_id == cob_id and frames.alike(each.data, data) for each, data in zip(given, wanted, strict=True)
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
        asked, told = (frames.upload if reading else frames.download)(f, data)
        return (
            [WireMessage(each, frames.REQUESTS + UNIT) for each in asked],
            [WireMessage(each, frames.ANSWERS + UNIT) for each in told],
        )
    held = {f.name: data}
    asking = frames.read_request(contract, held) if reading else frames.write_request(contract, held)
    answer = frames.read_reply(contract, held) if reading else frames.write_reply(asking)
    unit = max(UNIT, contract.manners.units[0]) if contract.manners.units[1] else 0
    return [WireMessage(frames.framed(unit, asking))], [WireMessage(frames.framed(unit, answer))]


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
