"""The digest of a contract, by which a run knows whether a device is still what it was."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields
from typing import Any

from palpate.instrument.contracts.declaration import Declaration
from palpate.instrument.contracts.field import Field
from palpate.instrument.contracts.manners import Manners
from palpate.instrument.contracts.pdo import Pdo

# Keys of the first digests. All others were added later, and are left out where they have their default, so that the
# digest of a contract that does not use them is still that of the first runs.
FIRST_OF_FIELD = (
    "name", "address", "type", "meaning", "unit", "scale", "access", "minimum", "maximum", "default", "choices", "bits",
    "length",
)  # fmt: skip
FIRST_OF_CONTRACT = ("name", "bus", "identity", "fields", "pdos")
FIRST_OF_PDO = ("name", "base", "fields")
FIRST_OF_MANNERS = ("most_read", "most_written", "gap", "responds", "units", "together")
FOR_PEOPLE = ("title",)


def digest(contract: Declaration) -> str:
    """SHA-256 of a whole declaration, without what is for people only."""
    declared = _said(contract, FIRST_OF_CONTRACT)
    declared["fields"] = [_said(f, FIRST_OF_FIELD) for f in contract.fields]
    return hashlib.sha256(json.dumps(declared, sort_keys=True, default=_plain).encode()).hexdigest()


def _said(thing: Field | Declaration | Pdo | Manners, first: tuple[str, ...]) -> dict[str, Any]:
    """The first keys of a field, contract or PDO, and those of the others that are not at their default."""
    found: dict[str, Any] = {}
    for each in fields(thing):
        default = each.default if each.default is not MISSING else None
        value = getattr(thing, each.name, default)
        if each.compare and each.name not in FOR_PEOPLE and (each.name in first or value != default):
            found[each.name] = value
    return found


def _plain(value: Any) -> Any:
    """A mapping or dataclass as a dict, for JSON."""
    if isinstance(value, Pdo):
        return _said(value, FIRST_OF_PDO)
    if isinstance(value, Manners):
        return _said(value, FIRST_OF_MANNERS)
    return dict(value) if isinstance(value, Mapping) else asdict(value)
