"""The objects by which a client sets the process data of a simulated node up (CiA 301, 7.5.2.35 to 7.5.2.38)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from canopen.sdo.exceptions import SdoAbortedError

from palpate.instrument.contracts.contract import Contract, Pdo, sdo
from palpate.instrument.contracts.pdo import (
    AT_SYNC,
    COB_ID,
    KEPT,
    MOST_ENTRIES,
    OF_A_NODE,
    PDOS,
    SENT,
    TRANSMISSION_TYPE,
)

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
