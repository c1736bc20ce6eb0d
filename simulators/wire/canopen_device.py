"""What all simulated CANopen nodes share: the objects of their contract, and the refusal of what a node must refuse."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, Self

import numpy as np
import numpy.typing as npt
from canopen.sdo.exceptions import SdoAbortedError

from palpate.instrument.contracts.contract import Contract, Field, Pdo
from palpate.instrument.contracts.field import codec
from palpate.instrument.contracts.pdo import is_relative
from palpate.simulators.clock import VirtualClock
from palpate.simulators.linear.lti import Floats
from palpate.simulators.wire.device import SimulatedPlace
from palpate.simulators.wire.pdo_objects import PdoObjects

Times = npt.NDArray[np.int64]

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
        self.settings = {f.name: float(f.default) for f in self.contract.fields if f.type != "text"}
        self.settings["serial"] = float(self._serial)
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

    def frames_at(self, time_ns: Times, films: Callable[[], Floats], period_ns: int) -> list[tuple[int, list[bytes]]]:
        """What the node sends at some SYNCs: the identifier of each message with the data of all its frames.

        Args:
            time_ns: times of the SYNCs, shape (n,) [ns].
            films: gives the voltages of all films at these times, shape (films, n) [V].
            period_ns: the SYNC period [ns].
        """
        return [(pdo.cob_id(self.id), len(time_ns) * [self.packed(pdo)]) for pdo in self.at_sync()]

    def packed(self, pdo: Pdo) -> bytes:
        """Data of a PDO as the objects are now."""
        fields = [self.contract[name] for name in pdo.fields]
        return b"".join(codec(f.type, "<").pack(self.read(f)) for f in fields)
