"""Which requests read or write some fields of a Modbus device."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import BITS, ONE_REGISTER, READS, Field, Table
from palpate.instrument.errors import UsageError

MOST_BITS = 1968  # coils or discrete inputs of one request ("MODBUS application protocol" 1.1b3, 6.11)
ONE_COIL = 5  # function code that writes one coil


@dataclass(frozen=True, slots=True)
class Read:
    """One request that reads fields.

    Attributes:
        names: the fields.
        function: its function code.
        start: its first register, or its first coil.
        count: number of these.
        places: place of each field in the bytes of the reply; a coil takes one byte.
        bits: whether it reads coils or discrete inputs.
        registers: makes bytes of the registers of its reply.
        wider: a request for the same fields and one beside them; None: there is none.
        apart: requests for the same fields, each only for those that must be read together; none: it is such a request.
    """

    names: tuple[str, ...]
    function: int
    start: int
    count: int
    places: list[slice]
    bits: bool
    registers: struct.Struct
    wider: Read | None = None
    apart: tuple[Read, ...] = ()


@dataclass(frozen=True, slots=True)
class ReadRequests:
    """The requests that read some fields, and the fields that tell their scales and signs.

    Attributes:
        names: the fields that are asked for.
        requests: the requests; between them they hold these fields, and those that are read along.
        along: fields that are read along.
        apart: fields that tell a scale, but stand too far away to be read along.
        scaled: whether some of the fields mean nothing without others.
        direct: whether one request gives the fields and those along, in this order.
    """

    names: tuple[str, ...]
    requests: tuple[Read, ...]
    along: tuple[str, ...]
    apart: tuple[str, ...]
    scaled: bool
    direct: bool


@dataclass(frozen=True, slots=True)
class Write:
    """One request that writes fields.

    Attributes:
        names: the fields, by address.
        function: its function code.
        start: its first register, or its first coil.
        count: number of these.
        bits: whether it writes coils.
        places: first byte of each field, if some of them are parts of one register; else nothing.
    """

    names: tuple[str, ...]
    function: int
    start: int
    count: int
    bits: bool
    places: tuple[int, ...] = ()

    def content(self, data: list[bytes]) -> list[Any]:
        """Registers or coils of the request, from the bytes of each field; bits that no field has are 0."""
        if self.bits:
            return [each != b"\0" for each in data]
        whole = b"".join(data)
        if self.places:
            merged = bytearray(2 * self.count)
            for at, each in zip(self.places, data, strict=True):
                for number, octet in enumerate(each, at):
                    merged[number] |= octet
            whole = bytes(merged)
        return list(struct.unpack(f">{self.count}H", whole))


def fits(contract: Contract, names: Iterable[str]) -> bool:
    """Whether one request can read all these fields: devices refuse to read registers that no field has."""
    fields = [contract[name] for name in names]
    if len({f.table for f in fields}) > 1:
        return False
    start, count = contract.block([f.name for f in fields])
    if count > _most(contract, fields[0].table):
        return False
    return not _holes(contract, fields[0].table, start, count)


def reading(contract: Contract, names: tuple[str, ...], *, scaled: bool = True) -> ReadRequests:
    """The requests that read fields; `scaled`: also what tells their scales and signs.

    Raises UsageError: fields whose sign is in one register stand too far apart for one request.
    """
    units: list[set[str]] = []
    apart: list[str] = []
    for name in names:
        f, unit = contract[name], {name}
        if scaled and f.sign:
            unit.add(f.sign[0])
        if scaled and f.scaling:
            if fits(contract, {*unit, f.scaling.told_by}):
                unit.add(f.scaling.told_by)
            elif f.scaling.told_by not in names:
                apart.append(f.scaling.told_by)
        touched = [each for each in units if each & unit]
        units = [each for each in units if not each & unit] + [unit.union(*touched)]
    for unit in units:
        if not fits(contract, unit):
            raise UsageError(f"{contract.title}: {', '.join(sorted(unit))} do not fit one request; read them apart")
    found: list[list[set[str]]] = []
    for unit in sorted(units, key=lambda unit: _order(contract, unit)):
        if found and fits(contract, unit.union(*found[-1])):
            found[-1].append(unit)
        else:
            found.append([unit])

    def ordered(some: Iterable[str]) -> tuple[str, ...]:
        return tuple(sorted(some, key=lambda name: _rank(names, name)))

    requests = tuple(
        _read(
            contract,
            ordered(set().union(*some)),
            wider=True,
            apart=tuple(_read(contract, ordered(unit)) for unit in some) if len(some) > 1 else (),
        )
        for some in found
    )
    along = tuple(name for each in requests for name in each.names if name not in names)
    wanting = scaled and any(contract[name].beside for name in names)
    direct = len(requests) == 1 and requests[0].names == (*names, *along)
    return ReadRequests(names, requests, along, tuple(dict.fromkeys(apart)), wanting, direct)


def _rank(names: tuple[str, ...], name: str) -> tuple[int, str]:
    return (names.index(name) if name in names else len(names), name)


def _order(contract: Contract, names: Iterable[str]) -> tuple[str, int]:
    """Where fields of one request stand: their table and first address."""
    fields = [contract[name] for name in names]
    return fields[0].table, min(f.address for f in fields)


def _most(contract: Contract, table: Table) -> int:
    return MOST_BITS if table in BITS else contract.manners.most_read


def _holes(contract: Contract, table: Table, start: int, count: int) -> bool:
    """Whether some of the addresses belong to no field."""
    some = (f for f in contract.fields if f.table == table)
    known = {at for f in some for at in range(f.address, f.address + f.width)}
    return not known.issuperset(range(start, start + count))


def _read(contract: Contract, names: tuple[str, ...], *, wider: bool = False, apart: tuple[Read, ...] = ()) -> Read:
    fields = [contract[name] for name in names]
    start, count = contract.block(names)
    size = 1 if fields[0].table in BITS else 2
    ends = [(size * (f.address - start), f.size) for f in fields]
    wide = widened(contract, names) if wider else names
    places = [slice(at, at + length) for at, length in ends]
    wider_read = _read(contract, wide) if wide != names else None
    registers = struct.Struct(f">{count}H")
    return Read(names, READS[fields[0].table], start, count, places, size == 1, registers, wider_read, apart)


def widened(contract: Contract, names: tuple[str, ...]) -> tuple[str, ...]:
    """These fields and one number field beside them that can be read with them, if there is one.

    That is none which a command waits for, because some devices clear it when it is read.
    """
    start, count = contract.block(names)
    table = contract[names[0]].table
    waited = {each.field for command in contract.commands for each in (command.done, command.failed) if each}
    beside = [
        f.name
        for f in contract.fields
        if f.table == table and f.access != "wo" and f.type != "text" and f.name not in waited
        and (start + count == f.address or f.address + f.width == start)
        and count + f.width <= _most(contract, table)
    ]  # fmt: skip
    return (*names, *beside[-1:])


def companions(contract: Contract, name: str) -> frozenset[str]:
    """The fields that must be written together with one, and itself: its run, and the other parts of its register."""
    found, queue = {name}, [name]
    while queue:
        f = contract[queue.pop()]
        shared = [each.name for each in contract.fields if f.part and _is_other_part(each, f)]
        runs = [run for run in contract.manners.together if f.name in run]
        new = set(itertools.chain(shared, *runs)) - found
        found |= new
        queue += new
    return frozenset(found)


def _is_other_part(other: Field, f: Field) -> bool:
    return other.access != "ro" and (other.table, other.address) == (f.table, f.address)


def write(contract: Contract, given: tuple[str, ...]) -> Write:
    """The request that writes fields. Raises UsageError: one request cannot write them, or not without others."""
    listed = ", ".join(given)
    if missing := set().union(*(companions(contract, name) for name in given)) - set(given):
        raise UsageError(
            f"{contract.title}: {listed} cannot be written without {', '.join(sorted(missing))}, which the device "
            "takes in the same request; give these as well"
        )
    names = tuple(sorted(given, key=lambda name: contract[name].address))
    fields = [contract[name] for name in names]
    start, count = contract.block(names)
    covered = {at for f in fields for at in range(f.address, f.address + f.width)}
    if len({f.table for f in fields}) > 1 or len(covered) != count:
        raise UsageError(f"{contract.title}: {listed} are not adjacent in the contract; write them one by one")
    functions = {f.writes for f in fields}
    if fields[0].table in BITS:
        most = MOST_BITS
        function = functions.pop() if count == 1 else 15
        if count > 1 and any(f.function == ONE_COIL for f in fields):
            most = 1
    else:
        function = functions.pop()
        most = 1 if function == ONE_REGISTER else contract.manners.most_written
    if functions - {function, ONE_COIL} or count > most:
        raise UsageError(
            f"{contract.title}: {listed} take {count} addresses, but one request of the device writes {most}; write "
            "them one by one"
        )
    places = tuple(2 * (f.address - start) for f in fields) if any(f.part for f in fields) else ()
    return Write(names, function, start, count, fields[0].table in BITS, places)
