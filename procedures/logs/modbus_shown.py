"""Modbus requests and replies for people: fields by their names, with the scales and signs that went by before."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field

from palpate.drivers.links.modbus import EXCEPTIONS
from palpate.instrument.contracts.contract import Contract, Field
from palpate.instrument.contracts.field import BITS, READS, WRITES, Table

IDENTIFY, EXCEPTION = 43, 0x80
WRITES_ONE, ON = (5, 6), 0xFF
READ_FROM: dict[int, Table] = {function: table for table, function in READS.items()}
WRITTEN_TO: dict[int, Table] = {function: table for table, functions in WRITES.items() for function in functions}


@dataclass
class Conversation:
    """What has gone by between this program and one device.

    Attributes:
        contract: its contract; None: it is not known.
        known: the numbers that its fields last had; a scale or a sign may be among them.
    """

    contract: Contract | None
    known: dict[str, float] = field(default_factory=dict)
    _asked: tuple[int, int, int] = (0, 0, 0)  # function, address and count of the last request

    def pdu(self, pdu: bytes, *, sent: bool) -> str:
        """Text of a request (`sent`) or a reply, without unit id and check sum."""
        function, body = pdu[0], pdu[1:]
        if function & EXCEPTION:
            code = body[0] if body else 0
            return f"exception {code}, {EXCEPTIONS.get(code, 'unknown')}"
        if function == IDENTIFY:
            return "identify" if sent else "identity " + " ".join(_texts(body[6:]))
        address, count = int.from_bytes(body[:2]), int.from_bytes(body[2:4])
        if sent:
            self._asked = (function, address, count)
        if function in READ_FROM:
            table = READ_FROM[function]
            if sent:
                return f"read {self._names(table, address, count)}"
            return self._values(table, self._asked[1], _bits(body[1:], self._asked[2]) if table in BITS else body[1:])
        if function in WRITTEN_TO:
            return f"write {self._values(*_written(function, address, count, body))}" if sent else "written"
        return f"function {function}"

    def _names(self, table: Table, address: int, count: int) -> str:
        if self.contract is None:
            return f"{count} {'bits' if table in BITS else 'registers'} from 0x{address:04x}"
        return ", ".join(f.name for f in self._among(table, address, count)) or f"{count} from 0x{address:04x}"

    def _among(self, table: Table, address: int, count: int) -> list[Field]:
        assert self.contract is not None
        return [f for f in self.contract.fields if f.table == table and address <= f.address < address + count]

    def _values(self, table: Table, address: int, data: bytes) -> str:
        width = 1 if table in BITS else 2
        among = [] if self.contract is None else self._among(table, address, -(-len(data) // width))
        if self.contract is None or not among:
            return f"0x{address:04x}: {data.hex(' ')}"
        found = {f.name: data[width * (f.address - address) :][: f.size] for f in among}
        take(self.contract, found, self.known)
        return ", ".join(self.contract.shown(name, content, self.known) for name, content in found.items())


def take(contract: Contract, contents: dict[str, bytes], known: dict[str, float]) -> None:
    """Keep the numbers of fields, by which those of others may be scaled."""
    for name, content in contents.items():
        f = contract[name]
        if f.type != "text" and not f.beside and len(content) == f.size:
            with suppress(ValueError):
                value = contract.decode(name, content)
                if math.isfinite(value):
                    known[name] = value


def _bits(data: bytes, count: int) -> bytes:
    """A byte for each bit of a reply."""
    return bytes(data[n // 8] >> n % 8 & 1 for n in range(min(count, 8 * len(data))))


def _written(function: int, address: int, count: int, body: bytes) -> tuple[Table, int, bytes]:
    """Table, address and content of a write, with a byte for each bit."""
    table = WRITTEN_TO[function]
    if function in WRITES_ONE:
        return table, address, bytes([body[2:3] == bytes([ON])]) if table in BITS else body[2:4]
    return table, address, _bits(body[5:], count) if table in BITS else body[5:]


def _texts(data: bytes) -> Iterator[str]:
    while len(data) >= 2:
        size = data[1]
        yield repr(data[2 : 2 + size].decode("ascii", "replace"))
        data = data[2 + size :]
