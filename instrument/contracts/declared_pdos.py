"""Checks that the process data of a contract can be on a CAN bus, and that a driver can set them up."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.instrument.contracts.contradictions import check_name, check_once
from palpate.instrument.contracts.declaration import Declaration
from palpate.instrument.contracts.field import Field
from palpate.instrument.contracts.pdo import LONGEST_INHIBIT, NODES, PDOS, SENT, TAKEN, Pdo
from palpate.instrument.errors import ConfigError

LARGEST_PDO = 8  # bytes


def check_pdos(contract: Declaration, fields: Mapping[str, Field]) -> None:
    """Raises ConfigError: a PDO cannot be sent on a CAN bus, or cannot hold one of its fields."""
    if contract.bus != "canopen" and (contract.pdos or contract.receives):
        raise ConfigError(f"{contract.title}: has PDOs, which are for CANopen only; leave them out")
    for pdo, wrong in (*((each, "wo") for each in contract.pdos), *((each, "ro") for each in contract.receives)):
        for name in pdo.fields:
            if name not in fields or fields[name].type == "text" or fields[name].access == wrong:
                raise ConfigError(
                    f"{contract.title}: PDO {pdo.name} cannot hold {name}: it must be a number field of the contract "
                    f"that can be {'read' if wrong == 'wo' else 'written'}"
                )
        if len(set(pdo.fields)) < len(pdo.fields):
            raise ConfigError(f"{contract.title}: PDO {pdo.name} holds a field twice: {', '.join(pdo.fields)}")
        if not 0 < (size := sum(fields[name].size for name in pdo.fields)) <= LARGEST_PDO:
            raise ConfigError(f"{contract.title}: PDO {pdo.name} has {size} bytes; give 1 to {LARGEST_PDO}")
    for first, pdos in ((SENT, contract.pdos), (TAKEN, contract.receives)):
        placed = [pdo for pdo in pdos if pdo.index or pdo.fixed]
        for pdo in placed:
            _check_place(contract, pdo, first)
        check_once(contract.title, "PDOs", [f"0x{pdo.index or pdo.fixed:X}" for pdo in placed])
    for pdo in (*contract.pdos, *contract.receives):
        check_name(f"{contract.title}: PDO", pdo.name)
    check_once(contract.title, "PDOs", [pdo.name for pdo in (*contract.pdos, *contract.receives)])


def _check_place(contract: Declaration, pdo: Pdo, first: int) -> None:
    """Raises ConfigError: no node can have this PDO at its place, or no driver can set it up."""
    if pdo.index and pdo.fixed:
        raise ConfigError(f"{contract.title}: PDO {pdo.name}: gives index and fixed; a driver sets it up, or it cannot")
    for what, given, least, most in (
        ("fixed" if pdo.fixed else "index", pdo.fixed or pdo.index, first, first + PDOS - 1),
        ("transmission", pdo.transmission, 0, 255),
        ("inhibit", pdo.inhibit, 0, LONGEST_INHIBIT),
        ("node", pdo.node, 0, NODES[-1]),
    ):
        if not least <= given <= most:
            limits = f"0x{least:X} to 0x{most:X}" if what in ("index", "fixed") else f"{least} to {most:g}"
            raise ConfigError(f"{contract.title}: PDO {pdo.name}: {what} = {given:g} is outside {limits}")
