"""What all simulated CANopen nodes share: the objects of their contract, and the refusal of what a node must refuse."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, Self

import numpy as np
from canopen.objectdictionary import ODVariable
from canopen.sdo.exceptions import SdoAbortedError
from canopen.sdo.server import SdoServer as CanopenSdoServer

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.bench.links import Octets
from palpate.instrument.contracts.contract import Contract, Field, Pdo, sdo
from palpate.instrument.contracts.declaration import (
    AT_SYNC,
    COB_ID,
    KEPT,
    MOST_ENTRIES,
    OF_A_NODE,
    PDOS,
    SENT,
    TRANSMISSION_TYPE,
    is_relative,
)
from palpate.instrument.contracts.field import codec
from palpate.simulators.clock import VirtualClock
from palpate.simulators.wire.device import SimulatedPlace, first_settings

# -------------------------------------------------------------------------------------------------------
# The objects by which a client sets the process data of a simulated node up (CiA 301, 7.5.2.35 to 7.5.2.38)

OFF, NO_RTR = 0x8000_0000, 0x4000_0000  # bits of a COB-ID
IDENTIFIER = 0x7FF
WHEN_IT_WANTS = 255  # transmission type
RESERVED = range(0xF1, 0xFC)  # transmission types
REMOTE = (0xFC, 0xFD)  # transmission types of what a node sends when it is asked to
OF_OTHERS = [range(base + 1, base + 128) for what, base in OF_A_NODE.items() if what != "emergencies"]
LARGEST = 8  # bytes of a frame
NOT_MAPPABLE, TOO_LONG = 0x0604_0041, 0x0604_0042
NOT_NOW, WRONG_VALUE = 0x0800_0022, 0x0609_0030


@dataclass
class _State:
    """What a node holds of one PDO; at power-on it is on, and holds nothing."""

    cob_id: int
    transmission: int = WHEN_IT_WANTS
    inhibit: int = 0
    count: int = 0
    entries: dict[int, int] = field(default_factory=dict)


class PdoObjects:
    """Communication and mapping objects of the PDOs that a driver sets up, and of those that nobody can set up."""

    def __init__(self, contract: Contract, node_id: int) -> None:
        self._contract, self._id = contract, node_id
        self._fields = {f.address: f for f in contract.fields if f.type != "text"}
        self._pdos = {at: pdo for pdo in (*contract.pdos, *contract.receives) if (at := pdo.index or pdo.fixed)}
        self.reset()

    def reset(self) -> None:
        """Return to the state after power-on."""
        self._states = {index: _State(pdo.cob_id(self._id) | NO_RTR) for index, pdo in self._pdos.items()}
        for index, pdo in self._pdos.items():
            if pdo.fixed:
                fields = [self._contract[name] for name in pdo.fields]
                entries = {number: f.address << 8 | 8 * f.size for number, f in enumerate(fields, 1)}
                self._states[index] = _State(pdo.cob_id(self._id), pdo.transmission, 0, len(entries), entries)

    def has(self, index: int) -> bool:
        """Whether an object is one of these."""
        return index in self._states or index - PDOS in self._states

    def read(self, index: int, subindex: int) -> int | None:
        """Value of an object; None: canopen itself holds it."""
        if index in self._states:
            state = self._states[index]
            return {COB_ID: state.cob_id, TRANSMISSION_TYPE: state.transmission, 3: state.inhibit}.get(subindex)
        state = self._states[index - PDOS]
        return state.entries.get(subindex, 0) if subindex else state.count

    def write(self, index: int, subindex: int, value: int) -> None:
        """Take what a client writes. Raises SdoAbortedError: the node must refuse it."""
        if index in self._states:
            self._write_communication(self._states[index], index >= SENT, subindex, value)
        else:
            self._write_mapping(self._states[index - PDOS], index - PDOS >= SENT, subindex, value)

    @staticmethod
    def _write_communication(state: _State, sent: bool, subindex: int, value: int) -> None:
        if subindex == COB_ID:
            identifier = value & ~(OFF | NO_RTR)
            moved = (value ^ state.cob_id) & IDENTIFIER and not (value | state.cob_id) & OFF
            kept = identifier > IDENTIFIER or any(identifier in each for each in (*KEPT, *OF_OTHERS))
            if moved or (value ^ state.cob_id) & NO_RTR or (kept and not value & OFF):
                raise SdoAbortedError(WRONG_VALUE)
            state.cob_id = value
        elif subindex == TRANSMISSION_TYPE:
            if value in RESERVED or (value in REMOTE and not sent):
                raise SdoAbortedError(WRONG_VALUE)
            state.transmission = value
        else:
            state.inhibit = value

    def _write_mapping(self, state: _State, sent: bool, subindex: int, value: int) -> None:
        if not state.cob_id & OFF or (subindex and state.count):
            raise SdoAbortedError(NOT_NOW)
        if subindex:
            f = self._fields.get(value >> 8)
            if f is None or value & 0xFF != 8 * f.size or f.access == ("wo" if sent else "ro"):
                raise SdoAbortedError(NOT_MAPPABLE)
            state.entries[subindex] = value
            return
        if value > MOST_ENTRIES or any(number not in state.entries for number in range(1, value + 1)):
            raise SdoAbortedError(NOT_MAPPABLE)
        if sum(state.entries[number] & 0xFF for number in range(1, value + 1)) > 8 * LARGEST:
            raise SdoAbortedError(TOO_LONG)
        state.count = value

    def as_set(self, pdo: Pdo) -> Pdo | None:
        """A PDO as it is set now; None: it is off, or holds nothing."""
        if not pdo.index:  # nobody can set it up
            return pdo
        state = self._states[pdo.index]
        if state.cob_id & OFF or not state.count:
            return None
        names = tuple(self._fields[state.entries[number] >> 8].name for number in range(1, state.count + 1))
        base = (state.cob_id & IDENTIFIER) - self._id
        return replace(pdo, base=base, fields=names, transmission=state.transmission)

    def at_sync(self, pdo: Pdo, held: dict[str, float]) -> bool:
        """Whether a PDO is sent at each SYNC; `held`: the node's settings."""
        if at := pdo.index or pdo.fixed:
            return self._states[at].transmission in AT_SYNC
        number = self._contract.pdos.index(pdo)
        name = next((f.name for f in self._contract.fields if f.address == sdo(SENT + number, TRANSMISSION_TYPE)), None)
        return name is not None and int(held[name]) in AT_SYNC


# --- canopen's SDO server, corrected where it does not follow CiA 301 ----------------------------------
#
# canopen's own server takes four bytes if a client does not say how many of them are valid, collects segments without
# a limit, answers segments that belong to no transfer, and answers a block upload in a way that the client did not
# offer.

EXPEDITED, SIZED, SUBCOMMAND = 2, 1, 3  # bits of a command byte
NOT_TOGGLED, UNKNOWN_COMMAND = 0x0503_0000, 0x0504_0001
NOT_WRITABLE = 0x0601_0002
DATA_TOO_LONG, DATA_TOO_SHORT = 0x0607_0012, 0x0607_0013
WORDS = struct.Struct("<BHB")  # command, index, subindex
ANY = 4  # most data bytes of an expedited transfer
LONGEST_TEXT = 1000  # bytes


class SdoServer(CanopenSdoServer):
    """Serves one transfer at a time, and refuses segments that belong to no transfer."""

    _begun = ""  # the transfer whose segments may come: "upload", "download", or none

    def abort(self, abort_code: int = 0x0800_0000) -> None:
        self._begun = ""
        super().abort(abort_code)  # type: ignore[no-untyped-call]

    def request_aborted(self, data: bytearray) -> None:
        self._begun = ""
        super().request_aborted(data)  # type: ignore[no-untyped-call]

    def init_upload(self, request: bytearray) -> None:
        self._begun = ""
        self._buffer = bytearray()
        super().init_upload(request)  # type: ignore[no-untyped-call]
        self._begun = "upload" if self._buffer else ""

    def segmented_upload(self, command: int) -> None:
        self._check_segment("upload", command)
        super().segmented_upload(command)  # type: ignore[no-untyped-call]
        self._begun = "upload" if self._buffer else ""

    def init_download(self, request: bytearray) -> None:
        """Begin a download, or refuse at once one whose announced size does not fit the object."""
        command, index, subindex = WORDS.unpack_from(request)
        self._index, self._subindex, self._begun = index, subindex, ""
        least, most = self._writable_sizes(index, subindex)
        if command & EXPEDITED and not command & SIZED:
            request = bytearray(request)
            request[0] |= SIZED | (ANY - min(most, ANY)) << 2
        elif command & SIZED and not command & EXPEDITED:
            (announced,) = struct.unpack_from("<L", request, 4)
            if not least <= announced <= most:
                raise SdoAbortedError(DATA_TOO_LONG if announced > most else DATA_TOO_SHORT)
        super().init_download(request)  # type: ignore[no-untyped-call]
        self._begun, self._most = "" if command & EXPEDITED else "download", most

    def segmented_download(self, command: int, request: bytearray) -> None:
        self._check_segment("download", command)
        if len(self._buffer or b"") + 7 - (command >> 1 & 7) > self._most:
            raise SdoAbortedError(DATA_TOO_LONG)
        super().segmented_download(command, request)  # type: ignore[no-untyped-call]
        self._begun = "" if command & 1 else "download"

    def block_upload(self, data: bytearray) -> None:
        """Answer with an ordinary upload if the client allows that for an object of this size; else refuse."""
        _, self._index, self._subindex = WORDS.unpack_from(data)
        offered = data[5]  # the protocol switch threshold [bytes]; 0: the client allows no ordinary upload
        if data[0] & SUBCOMMAND or not offered:
            raise SdoAbortedError(UNKNOWN_COMMAND)
        if len(self._node.get_data(self._index, self._subindex, check_readable=True)) > offered:
            raise SdoAbortedError(UNKNOWN_COMMAND)
        self.init_upload(data)

    def _check_segment(self, way: str, command: int) -> None:
        if self._begun != way:
            raise SdoAbortedError(UNKNOWN_COMMAND)
        if command & 0x10 != self._toggle:
            raise SdoAbortedError(NOT_TOGGLED)

    def _writable_sizes(self, index: int, subindex: int) -> tuple[int, int]:
        """Least and most bytes that a write of an object may have. Raises SdoAbortedError: it is not writable."""
        found: ODVariable = self._node._find_object(index, subindex)
        if not found.writable:
            raise SdoAbortedError(NOT_WRITABLE)
        size = len(found) // 8
        return (size, size) if found.data_type in found.STRUCT_TYPES else (1, LONGEST_TEXT)


# --- the base of the nodes -----------------------------------------------------------------------------


def octets(data: Sequence[bytes]) -> Octets:
    """The data of frames of one size, shape (n, bytes)."""
    return np.frombuffer(b"".join(data), np.uint8).reshape(len(data), -1)


VALUE_RANGE = 0x0609_0030


class NodeWire(Protocol):
    """What a node can do on the bus by itself."""

    @property
    def operational(self) -> bool:
        """Whether the node is in the NMT state in which it exchanges process data."""

    def transmit(self, pdo: Pdo) -> None:
        """Send process data now; a node that is not operational sends none."""

    def emergency(self, code: int) -> None:
        """Send an emergency message."""


class SimulatedNode:
    """The state of one node. Methods are called under the clock's lock."""

    contract: Contract
    wire: NodeWire | None = None  # None until the node is attached to a network
    speed = 1.0  # speed of this clock relative to the clients' clock
    rig: Any  # that of its place, once it stands on a bench

    @classmethod
    def at(cls, place: SimulatedPlace) -> Self:
        """Make the node for its place on a bench; a node whose constructor takes more arguments overrides this."""
        made = cls(place.clock, place.unit, place.serial)
        made.rig = place.rig
        return made

    def __init__(self, clock: VirtualClock, node_id: int, serial: int) -> None:
        self.id = node_id
        self.clock = clock
        self._serial = serial
        self.process_data = PdoObjects(self.contract, node_id)
        self.reset()

    def reset(self) -> None:
        """Return to the state after power-on."""
        self.settings = first_settings(self.contract)
        if self.contract.has(serial := self.contract.serial or "serial"):
            self.settings[serial] = float(self._serial)
        self.process_data.reset()

    def start(self) -> None:
        """Called when the node enters the NMT state operational."""

    def stop(self) -> None:
        """Called when a client ends the NMT state operational."""

    def read(self, field: Field) -> Any:
        """Raw value of an object, for the SDO server."""
        if field.name == "hardware_version":
            return "simulated"
        if field.type == "text":
            return field.default
        relative = self.id if is_relative(field.index, field.subindex) else 0
        return field.to_raw(self.settings[field.name]) + relative

    def write(self, field: Field, value: float) -> None:
        """Store a new physical value of a setting, which has been checked against the contract."""
        self.settings[field.name] = value

    def write_text(self, field: Field, text: str) -> None:
        """Take a text that a client writes."""
        raise SdoAbortedError(VALUE_RANGE)

    def receive(self, pdo: Pdo, values: Mapping[str, float]) -> None:
        """Take process data, whose values have been checked against the contract."""
        for name in pdo.fields:
            self.write(self.contract[name], values[name])

    def receive_cycle(self, pdo: Pdo, values: Sequence[Mapping[str, float]], period_ns: int) -> None:
        """Take process data that come over and over from now on, one each `period_ns`; none: they have ended."""

    def heard(self, node_id: int) -> None:
        """Called at each heartbeat of another node, if this one can watch them (1016h)."""

    def transmit(self, name: str) -> None:
        """Send the PDO of that name now; a node that is not operational sends none. Raises UnknownName."""
        pdo = self.process_data.as_set(self.contract.sent(name))
        if self.wire is not None and pdo is not None:
            self.wire.transmit(pdo)

    def emergency(self, code: int) -> None:
        """Send an emergency message."""
        if self.wire is not None:
            self.wire.emergency(code)

    def at_sync(self) -> list[Pdo]:
        """The PDOs that the node sends at each SYNC, by their transmission types, as they are set now."""
        sent = [pdo for pdo in self.contract.pdos if self.process_data.at_sync(pdo, self.settings)]
        return [pdo for pdo in map(self.process_data.as_set, sent) if pdo is not None]

    def frames_at(self, time_ns: Times, films: Callable[[], Floats], period_ns: int) -> list[tuple[int, Octets]]:
        """What the node sends at some SYNCs: the identifier of each message with the data of its frames (n, bytes).

        Args:
            time_ns: times of the SYNCs, shape (n,) [ns].
            films: gives the voltages of all films at these times, shape (films, n) [V].
            period_ns: the SYNC period [ns].
        """
        return [(pdo.cob_id(self.id), octets(len(time_ns) * [self.packed(pdo)])) for pdo in self.at_sync()]

    def sampled(self) -> None:
        """Called when the frames of `frames_at` are on the bus."""

    def packed(self, pdo: Pdo) -> bytes:
        """Data of a PDO as the objects are now."""
        fields = [self.contract[name] for name in pdo.fields]
        return b"".join(codec(f.type, "<").pack(self.read(f)) for f in fields)
