"""Export of the contracts: register tables for people, the node's EDS for CANopen tools, a DBC for loggers.

All of them are generated from the contracts, so they always agree with the wire. The files hold no date and no path, so
two exports of the same contracts are the same bytes.
"""

from __future__ import annotations

import inspect
import io
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.instrument.additions import library
from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.contract import Contract, Field, Value
from palpate.instrument.contracts.declaration import Pdo, is_relative
from palpate.instrument.contracts.own import SYNC_COB_ID
from palpate.instrument.errors import RecordError, reason

if TYPE_CHECKING:
    from cantools.database.can import Message, Signal

NODE_IDS = range(1, 21)  # node ids in the DBC; the largest bench has 20 nodes
HEARTBEAT, EMERGENCY = 0x700, 0x80  # COB-IDs of node 0, CiA 301
NMT_STATES = {0: "boot_up", 4: "stopped", 5: "operational", 127: "pre_operational"}  # CiA 301

_OURS = "These maps are Palpate's own and no real device's"
_WHOSE = (
    "The maps of the usual devices are Palpate's own and no real device's; the real maps that one imitates are named "
    "with it. The others describe devices of makers or of packages."
)
_COLUMNS = ("address", "name", "type", "unit", "scale", "access", "limits", "default", "choices or bits", "meaning")
_RATE = "BaudRate_"  # [kbit/s]
# CiA 306 requires dates. All are 1970-01-01, so that two exports are equal to the byte.
_EDS_FILE = {
    "FileName": "sensor_node.eds",
    "FileVersion": 1,
    "FileRevision": 0,
    "EdsVersion": "4.0",
    "CreatedBy": "Palpate",
    "CreationDate": "01-01-1970",
    "CreationTime": "12:00AM",
    "ModificationDate": "01-01-1970",
    "ModificationTime": "12:00AM",
}


def export_contracts(folder: Path, contracts: Iterable[Contract] = tuple(CONTRACTS.values())) -> list[Path]:
    """Write `registers.md`, `sensor_node.eds` and `bench.dbc` into `folder`; existing files are overwritten.

    Returns:
        The three paths, in that order.

    Raises:
        UsageError: the library that writes a DBC is not installed.
        RecordError: the folder cannot be made, or a file in it cannot be written.
    """
    texts = {
        "registers.md": registers(contracts),
        "sensor_node.eds": node_eds(CONTRACTS["sensor_node"]),
        "bench.dbc": bench_dbc(CONTRACTS["sensor_node"]),
    }
    written = []
    path = folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            path = folder / name
            path.write_bytes(text.encode())
            written.append(path)
    except OSError as error:
        raise RecordError(f"{path}: cannot be written: {reason(error)}; name another folder") from None
    return written


# --- for people ----------------------------------------------------------------------------------------


def registers(contracts: Iterable[Contract]) -> str:
    """Markdown text: an introduction, then each device with its identity and its register table."""
    parts = ["# Registers and objects", _WHOSE]
    for contract in contracts:
        parts += [
            f"## {contract.title}",
            inspect.cleandoc(contract.about),
            _wire(contract),
            f"Contract `{contract.name}`, SHA-256 `{contract.digest()}`.",
            register_table(contract),
            *(_pdo_line(pdo, f"TPDO {number}") for number, pdo in enumerate(contract.pdos, 1)),
            *(_pdo_line(pdo, f"RPDO {number}") for number, pdo in enumerate(contract.receives, 1)),
        ]
    return "\n\n".join(parts) + "\n"


def register_table(contract: Contract) -> str:
    """Markdown table of all fields of one device, one row a field.

    Limits and default are physical values in the field's unit; physical value = scale x raw value.
    """
    rows = [_COLUMNS, ("---",) * len(_COLUMNS), *(_row(contract, f) for f in contract.fields)]
    return "\n".join("| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in rows)


def _wire(contract: Contract) -> str:
    modbus = contract.bus == "modbus"
    held = "Modbus registers, high word first where not said otherwise" if modbus else "CANopen objects, little-endian"
    if contract.known_by == "marks":
        marks = "Known by " + ", ".join(f"{mark.field} = {mark.value}" for mark in contract.marks)
    elif contract.known_by == "nothing":
        marks = "Tells nothing by which it is known, so that its label counts"
    else:
        marks = f"Identity ({'function 43/14' if modbus else 'object 0x1018'})"
    identity = contract.identity
    return (
        f"{held}. {marks}: vendor {identity.vendor}, product {identity.product}, revision {identity.revision or 'any'}."
    )


def _pdo_line(pdo: Pdo, what: str) -> str:
    cob_id = f"0x{pdo.cob_id(pdo.node):X} at node id {pdo.node} alone" if pdo.node else f"0x{pdo.base:X} + node id"
    return f"{what} ({pdo.name}), COB-ID {cob_id}: {', '.join(pdo.fields)}."


def _row(contract: Contract, f: Field) -> tuple[str, ...]:
    address = f"0x{f.address:04X}" if contract.bus == "modbus" else f"0x{f.index:04X}:{f.subindex:02X}"
    address = address if f.table == "holding" else f"{f.table} {address}"
    named = [f"{raw} {choice}" for choice, raw in f.choices.items()]
    named += [f"bit {number} {bit}" for bit, number in f.bits.items()]
    return (
        address, f.name, _type(f), f.unit, "" if f.type == "text" else _scale(f), f.access,
        _limits(f), _default(contract, f), ", ".join(named), f.meaning,
    )  # fmt: skip


def _type(f: Field) -> str:
    """The type, with what of its bytes is not usual."""
    parts: list[str] = [f.type]
    parts += ["low word first"] if f.words == "little" else []
    parts += ["low byte first"] if f.octets == "little" else []
    parts += [f"bits {f.part[0]} to {sum(f.part) - 1}"] if f.part else []
    return ", ".join(parts)


def _scale(f: Field) -> str:
    """The scale, with the fields that tell it, the zero and the sign."""
    parts = [_number(f.scale)]
    parts += [f"from {_number(f.offset)}"] if f.offset else []
    parts += [f"{f.scaling.by} in {f.scaling.told_by}"] if f.scaling else []
    parts += [f"sign in {f.sign[0]}.{f.sign[1]}"] if f.sign else []
    return ", ".join(parts)


def _limits(f: Field) -> str:
    if f.length:
        return f"up to {f.length} bytes"
    if f.minimum is None or f.maximum is None:
        return ""
    return f"{_number(f.minimum)} to {_number(f.maximum)}"


def _default(contract: Contract, f: Field) -> str:
    if isinstance(f.default, str):
        return f.default
    if f.access == "wo":
        return ""
    return contract.choice(f.name, f.default) if f.choices else _number(f.default)


def _number(value: Value) -> str:
    return f"{value:.10g}"


# --- for CANopen tools ---------------------------------------------------------------------------------


def node_eds(contract: Contract) -> str:
    """The node's electronic data sheet (CiA 306), COB-IDs of its PDOs relative to the node id."""
    from canopen.objectdictionary.eds import export_eds

    from palpate.instrument.contracts.object_dictionary import object_dictionary

    dictionary = object_dictionary(contract)
    dictionary.device_information.vendor_name = "Palpate"
    dictionary.comments = f"{_OURS}.\nContract {contract.name}, SHA-256 {contract.digest()}"
    for f in contract.fields:
        variable = dictionary.get_variable(f.index, f.subindex)
        variable.description = f.meaning.replace(";", ",")  # a semicolon begins a comment
        if is_relative(f.index, f.subindex):
            variable.default_raw = f"$NODEID+0x{int(f.default):X}"
    text = io.StringIO()
    with warnings.catch_warnings():  # the library's own dates warn from Python 3.12 on; they are not used
        warnings.filterwarnings("ignore", r"datetime\.datetime\.utcnow", DeprecationWarning)
        export_eds(dictionary, text, dict(_EDS_FILE))  # type: ignore[no-untyped-call]
    # The library takes the bit rates from a set, whose order depends on whether Python has compiled the library before.
    lines = text.getvalue().splitlines(keepends=True)
    places = [place for place, line in enumerate(lines) if line.startswith(_RATE)]
    rates = sorted((lines[place] for place in places), key=lambda line: int(line.removeprefix(_RATE).split("=")[0]))
    for place, line in zip(places, rates, strict=True):
        lines[place] = line
    return "".join(lines)


# --- for loggers ---------------------------------------------------------------------------------------


def bench_dbc(contract: Contract) -> str:
    """DBC of everything that nodes 1 to 20 send (TPDOs, heartbeat, emergency), and of SYNC."""
    library("cantools", "dbc")
    from cantools.database.can import Database, Message, Node

    messages = [
        Message(SYNC_COB_ID, "SYNC", 0, [], comment="All operational nodes sample.", senders=[_node(NODE_IDS[0])])
    ]
    for node_id in NODE_IDS:
        messages += _messages(contract, node_id)
    nodes = [Node(_node(node_id), comment=f"{contract.title}, node id {node_id}") for node_id in NODE_IDS]
    database = Database(messages, nodes, version=f"Palpate {contract.name} {contract.digest()[:16]}")
    return database.as_dbc_string()


def _node(node_id: int) -> str:
    return f"SN{node_id:02d}"


def _messages(contract: Contract, node_id: int) -> list[Message]:
    """Messages that one node sends."""
    from cantools.database.can import Message

    sender = _node(node_id)
    messages = []
    for number, pdo in enumerate(contract.pdos, 1):
        signals, start = [], 0
        for name in pdo.fields:
            signals.append(_field_signal(contract[name], start))
            start += 8 * contract[name].size
        comment = f"TPDO {number} of node {node_id}"
        messages.append(
            Message(pdo.base + node_id, f"{sender}_{pdo.name}", start // 8, signals, comment=comment, senders=[sender])
        )
    state = _signal("nmt_state", 0, 8, choices=NMT_STATES)
    emergency = [
        _signal("error_code", 0, 16, comment="error code, CiA 301; 0 is: no error any more"),
        _signal("error_register", 16, 8, comment=_bits(contract["error_register"])),
        _signal("manufacturer", 24, 40),
    ]
    messages.append(Message(HEARTBEAT + node_id, f"{sender}_heartbeat", 1, [state], senders=[sender]))
    messages.append(Message(EMERGENCY + node_id, f"{sender}_emergency", 8, emergency, senders=[sender]))
    return messages


def _field_signal(f: Field, start: int) -> Signal:
    signal = _signal(
        f.name, start, 8 * f.size, signed=f.type.startswith("int"), scale=f.scale, unit=f.unit, comment=_bits(f)
    )
    if f.minimum is not None and f.maximum is not None:
        signal.minimum, signal.maximum = f.minimum, f.maximum
    return signal


def _signal(
    name: str, start: int, bits: int, *, signed: bool = False, scale: float = 1.0, unit: str = "",
    choices: dict[int, str] | None = None, comment: str = "",
) -> Signal:  # fmt: skip
    """A little-endian integer whose limits are those of its width."""
    from cantools.database.can import Signal
    from cantools.database.conversion import BaseConversion

    conversion: Any = BaseConversion.factory(scale=scale, choices=choices)  # type: ignore[arg-type]
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    return Signal(
        name, start, bits, is_signed=signed, conversion=conversion, minimum=low * scale, maximum=high * scale,
        unit=unit or None, comment=comment or None,
    )  # fmt: skip


def _bits(f: Field) -> str:
    named = ", ".join(f"bit {number} {bit}" for bit, number in f.bits.items())
    return f"{f.meaning}: {named}" if named else f.meaning
