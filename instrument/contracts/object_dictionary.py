"""Object dictionary of the node, made from its contract, for the simulated node and for the EDS."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import canopen
from canopen.objectdictionary import ODArray, ODRecord, ODVariable, datatypes

from palpate.instrument.contracts.contract import Contract, Field
from palpate.instrument.contracts.declaration import MOST_ENTRIES, PDOS, SENT, TAKEN, Pdo

_TYPES = {
    "uint8": datatypes.UNSIGNED8,
    "int8": datatypes.INTEGER8,
    "bool": datatypes.BOOLEAN,
    "uint24": datatypes.UNSIGNED24,
    "int24": datatypes.INTEGER24,
    "uint64": datatypes.UNSIGNED64,
    "int64": datatypes.INTEGER64,
    "float64": datatypes.REAL64,
    "uint16": datatypes.UNSIGNED16,
    "int16": datatypes.INTEGER16,
    "uint32": datatypes.UNSIGNED32,
    "int32": datatypes.INTEGER32,
    "float32": datatypes.REAL32,
    "text": datatypes.VISIBLE_STRING,
}


def object_dictionary(contract: Contract) -> Any:
    """A `canopen.ObjectDictionary` of all objects of the contract, with its PDO mappings."""
    od: Any = canopen.ObjectDictionary()  # type: ignore[no-untyped-call]
    od.device_information.vendor_name = contract.identity.vendor
    od.device_information.product_name = contract.title
    if contract.known_by == "identity":  # else its identity is text for people
        od.device_information.vendor_number = int(contract.identity.vendor, 16)
        od.device_information.product_number = int(contract.identity.product or "0", 16)
        od.device_information.revision_number = int(contract.identity.revision or "0", 16)
    od.device_information.nr_of_TXPDO = len(contract.pdos)
    od.device_information.nr_of_RXPDO = len(contract.receives)
    od.device_information.allowed_baudrates = {1_000_000}
    mapped = {name for pdo in (*contract.pdos, *contract.receives) for name in pdo.fields}
    by_index: dict[int, list[Field]] = {}
    for f in contract.fields:
        by_index.setdefault(f.index, []).append(f)
    for index, fields in sorted(by_index.items()):
        if len(fields) == 1 and fields[0].subindex == 0:
            od.add_object(_variable(fields[0], mapped))
        else:
            _add_group(od, index, fields[0].name.rsplit("_", 1)[0], [_variable(f, mapped) for f in fields])
    for first, pdos in ((SENT, contract.pdos), (TAKEN, contract.receives)):
        for index, pdo in enumerate(pdos, first + PDOS):
            if pdo.index or pdo.fixed:
                _add_communication(od, pdo)
            if pdo.index:
                _add_mapping(od, pdo)
                continue
            at = pdo.fixed + PDOS if pdo.fixed else index
            entries = []
            for sub, name in enumerate(pdo.fields, 1):
                f = contract[name]
                entry = ODVariable(name, at, sub)
                entry.data_type, entry.access_type = datatypes.UNSIGNED32, "const"
                entry.default = f.index << 16 | f.subindex << 8 | 8 * f.size
                entries.append(entry)
            _add_group(od, at, f"mapping of {pdo.name}", entries)
    return od


def _add_communication(od: Any, pdo: Pdo) -> None:
    """The communication objects of a PDO: a client may write them all, or none if the node has it fixed."""
    unsigned = {8: datatypes.UNSIGNED8, 16: datatypes.UNSIGNED16, 32: datatypes.UNSIGNED32}
    parts: list[Any] = []
    for sub, (name, bits) in enumerate((("COB-ID", 32), ("transmission type", 8), ("inhibit time", 16)), 1):
        parts.append(ODVariable(f"{name} of {pdo.name}", pdo.index or pdo.fixed, sub))
        parts[-1].data_type, parts[-1].access_type = unsigned[bits], "rw" if pdo.index else "const"
    _add_group(od, pdo.index or pdo.fixed, f"communication of {pdo.name}", parts)


def _add_mapping(od: Any, pdo: Pdo) -> None:
    """The mapping objects by which a client sets a PDO up."""
    mapping: list[Any] = [ODVariable(f"object {sub}", pdo.index + PDOS, sub) for sub in range(1, MOST_ENTRIES + 1)]
    for entry in mapping:
        entry.data_type, entry.access_type, entry.default = datatypes.UNSIGNED32, "rw", 0
    _add_group(od, pdo.index + PDOS, f"mapping of {pdo.name}", mapping)
    od[pdo.index + PDOS][0].access_type = "rw"


def _add_group(od: Any, index: int, name: str, members: list[Any]) -> None:
    group = (ODRecord if index < 0x2000 else ODArray)(name, index)
    count = ODVariable("highest subindex", index, 0)
    count.data_type, count.access_type, count.default = datatypes.UNSIGNED8, "const", len(members)
    for member in (count, *members):
        group.add_member(member)
    od.add_object(group)


def _variable(f: Field, mapped: Collection[str]) -> Any:
    variable: Any = ODVariable(f.name, f.index, f.subindex)
    variable.data_type, variable.access_type = _TYPES[f.type], f.access
    variable.description = f.meaning
    variable.unit, variable.factor = f.unit, f.scale
    variable.pdo_mappable = f.name in mapped
    if f.type == "text":
        variable.default = f.default
        return variable
    variable.default = f.to_raw(float(f.default))
    if f.minimum is not None and f.maximum is not None:
        variable.min, variable.max = f.to_raw(f.minimum), f.to_raw(f.maximum)
    return variable
