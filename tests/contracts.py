"""Contracts and data sheets of devices that nobody sells, for tests of what a map may say."""

from __future__ import annotations

from typing import Any

from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import Identity
from palpate.instrument.contracts.field import Field, Scaling

SCALE = Field("scale", 1, "uint16", "scale")
SCALED = Field("value", 0x10, "int16", "value", scaling=Scaling("scale"))


def modbus_contract(*fields: Field, **more: Any) -> Contract:
    """A Modbus device with these fields."""
    return Contract("thing", "thing", "modbus", Identity("Maker", "Thing", "1.0"), fields, **more)


def canopen_contract(*fields: Field, **more: Any) -> Contract:
    """A CANopen node with these objects; it has a number of its maker only."""
    return Contract("node", "node", "canopen", Identity("0x5F", "", ""), fields, **more)


def contract(*fields: Field, bus: str = "modbus", **more: Any) -> Contract:
    """A device with these fields on either bus."""
    return (modbus_contract if bus == "modbus" else canopen_contract)(*fields, **more)


def one(**given: Any) -> Contract:
    """A device with one field of these attributes."""
    return contract(Field(**{"name": "value", "address": 0x10, "type": "int32", "meaning": "value"} | given))


# --- EDS and DCF files of makers that do not exist, as facts of CiA 306 ------------------------------

U8, U16, U32, U64, I16, I24, F32, F64, TEXT, BIT = (
    "0x5",
    "0x6",
    "0x7",
    "0x1B",
    "0x3",
    "0x10",
    "0x8",
    "0x11",
    "0x9",
    "0x1",
)


def section(name: str, **keys: str) -> str:
    lines = [f"{key}={value}" for key, value in keys.items()]
    return "\n".join([f"[{name}]", *lines, "", ""])


def var(index: str, kind: str, access: str = "rw", **keys: str) -> str:
    return section(index, ParameterName="x", ObjectType="0x7", DataType=kind, AccessType=access, **keys)


def record(index: str, *members: tuple[str, str, str], count: str = "", count_access: str = "ro") -> str:
    """An object with subindices: type, access and default of each."""
    text = section(index, ParameterName="x", ObjectType="0x9", SubNumber=str(len(members) + 1))
    text += var(f"{index}sub0", U8, count_access, DefaultValue=count or str(len(members)))
    return text + "".join(
        var(f"{index}sub{number:X}", kind, access, DefaultValue=default)
        for number, (kind, access, default) in enumerate(members, 1)
    )


def pdo(
    number: int, cob_id: str, *entries: str, sends: bool = True, access: str = "rw", count: str = "", at: str = "255"
) -> str:
    """Communication and mapping of a PDO."""
    first, second = (0x1800, 0x1A00) if sends else (0x1400, 0x1600)
    text = record(f"{first + number:04X}", (U32, access, cob_id), (U8, access, at))
    mapping = [(U32, access, entry) for entry in entries]
    return text + record(f"{second + number:04X}", *mapping, count=count, count_access=access)


INFO = section("DeviceInfo", VendorName="Acme", VendorNumber="0x4D2", ProductName="Widget", ProductNumber="0x10")
IDENTITY = record("1018", (U32, "ro", "0x4D2"), (U32, "ro", "0x10"))
OBJECTS = var("1000", U32, "ro", DefaultValue="0") + var("1001", U8, "ro", DefaultValue="0") + IDENTITY
DATA = var("2000", U16, "ro") + var("2001", U16, "rww")
BASE = INFO + OBJECTS + DATA
MAPPED, TAKEN = "0x20000010", "0x20010010"


def node(number: str, **more: str) -> str:
    """The section by which a file becomes a DCF."""
    return section("DeviceComissioning", NodeID=number, **more)
