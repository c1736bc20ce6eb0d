"""The declaration of a device: its fields, its process data, its commands and its manners, which are found by name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from palpate.instrument.contracts.field import Field
from palpate.instrument.contracts.manners import USUAL, Command, Identity, Manners, Mark
from palpate.instrument.contracts.pdo import Pdo
from palpate.instrument.errors import UnknownName


@dataclass(frozen=True)
class Declaration:
    """All that is declared of one kind of device.

    Modbus contracts address 16-bit registers, coils and discrete inputs; CANopen contracts address objects, which are
    little-endian.

    Attributes:
        identity: vendor, product and revision: as the device reports them if `known_by` is `identity`, else for people.
        pdos: process data that a node sends; the first one has its COB-ID and its transmission type in 1800h.
        receives: process data that a node takes; the first one has its COB-ID in 1400h.
        about: for people: whose map it is, and what it imitates.
        known_by: how the right device is told from others: by its `identity` object, by `marks`, or by nothing, so that
            a person must confirm it.
        marks: what its fields read on each such device; all of them must fit.
        serial: field that holds its serial number; "": it is in its identity object, or nowhere.
        commands: orders that it takes.
        manners: limits on its bus.
    """

    name: str
    title: str
    bus: Literal["modbus", "canopen"]
    identity: Identity
    fields: tuple[Field, ...]
    pdos: tuple[Pdo, ...] = ()
    about: str = field(default="", compare=False)
    receives: tuple[Pdo, ...] = ()
    known_by: Literal["identity", "marks", "nothing"] = "identity"
    marks: tuple[Mark, ...] = ()
    serial: str = ""
    commands: tuple[Command, ...] = ()
    manners: Manners = USUAL
    _by_name: dict[str, Field] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Find fields by their names from now on."""
        object.__setattr__(self, "_by_name", {f.name: f for f in self.fields})

    def __getitem__(self, name: str) -> Field:
        try:
            return self._by_name[name]
        except KeyError:
            raise UnknownName(f"field of the {self.title}", name, self._by_name) from None

    def has(self, name: str) -> bool:
        """Whether there is a field of that name."""
        return name in self._by_name

    def block(self, names: Iterable[str]) -> tuple[int, int]:
        """First register and number of registers that hold the named fields (Modbus)."""
        fields = [self[n] for n in names]
        start = min(f.address for f in fields)
        end = max(f.address + f.width for f in fields)
        return start, end - start

    def command(self, name: str) -> Command:
        """An order that the device takes. Raises UnknownName."""
        found = {command.name: command for command in self.commands}
        if name not in found:
            raise UnknownName(f"command of the {self.title}", name, found)
        return found[name]

    def sent(self, name: str) -> Pdo:
        """Process data that a node sends. Raises UnknownName."""
        return self._pdo(name, self.pdos, "sends")

    def taken(self, name: str) -> Pdo:
        """Process data that a node takes. Raises UnknownName."""
        return self._pdo(name, self.receives, "takes")

    def _pdo(self, name: str, among: Sequence[Pdo], does: str) -> Pdo:
        found = {pdo.name: pdo for pdo in among}
        if name not in found:
            raise UnknownName(f"PDO that the {self.title} {does}", name, found)
        return found[name]
