"""Frames that are worked out from a map itself, for its author to check against the manual and to paste into it."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping
from typing import Any

from palpate.instrument.contracts.contract import Contract, Field
from palpate.instrument.contracts.maps import modbus_frames, sdo_frames
from palpate.instrument.contracts.maps.frame_tables import Message
from palpate.instrument.errors import PalpateError

UNIT = 1  # Modbus unit id, or node id, of the frames
SHARE = 0.3  # of its range: where a value without a default is taken from


def computed(contract: Contract, names: tuple[str, ...]) -> Iterator[str]:
    """A table `[[frame]]` for each of these fields, with a value of its range."""
    for name in names:
        try:
            yield _table(contract, contract[name])
        except (PalpateError, struct.error, ArithmeticError, KeyError) as error:
            yield f"# {name}: no frame can be worked out: {' '.join(str(error).split())}\n"


def _table(contract: Contract, f: Field) -> str:
    reading = f.access != "wo"
    beside = {name: _number(contract[name]) for name in f.beside}
    value = _value(f)
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


def _value(f: Field) -> Any:
    if f.type == "text":
        return "AB12"[: f.length] if f.length else "AB12"
    if f.bits:
        return [next(iter(f.bits))]
    if f.choices:
        return list(f.choices)[-1]
    return _number(f)


def _number(f: Field) -> float:
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


def _exchange(contract: Contract, f: Field, data: bytes, reading: bool) -> tuple[list[Message], list[Message]]:
    if contract.bus == "canopen":
        asked, told = (sdo_frames.upload if reading else sdo_frames.download)(f, data)
        return (
            [Message(each, sdo_frames.REQUESTS + UNIT) for each in asked],
            [Message(each, sdo_frames.ANSWERS + UNIT) for each in told],
        )
    held = {f.name: data}
    asking = modbus_frames.read_request(contract, held) if reading else modbus_frames.write_request(contract, held)
    answer = modbus_frames.read_reply(contract, held) if reading else modbus_frames.write_reply(asking)
    unit = max(UNIT, contract.manners.units[0]) if contract.manners.units[1] else 0
    return [Message(modbus_frames.framed(unit, asking))], [Message(modbus_frames.framed(unit, answer))]


def _texts(messages: list[Message]) -> str:
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
