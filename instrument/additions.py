"""What installed packages add to this one, by entry points: kinds of devices, procedures, effects.

A package declares an addition by its name in a group:

[project.entry-points."palpate.devices"]
acme-oven = "acme_oven:KIND"

A package that is broken hinders nobody who does not ask for what it adds.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from typing import Any

from palpate.instrument.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Addition:
    """One entry point.

    Attributes:
        name: that bench files, scenes and records call it by.
        place: where it stands, "module:name".
        package, version: of who adds it; empty where nobody knows.
    """

    name: str
    place: str
    package: str
    version: str

    @property
    def origin(self) -> str:
        """The package with its version, as text for people."""
        return f"{self.package} {self.version}".strip() or self.place


@cache
def additions(group: str) -> Mapping[str, Sequence[Addition]]:
    """Everything that installed packages add to a group, by name in the order of names; normally one each."""
    found: dict[str, list[Addition]] = {}
    for entry in sorted(entry_points(group=group), key=lambda entry: (entry.name, entry.value)):
        package, version = (entry.dist.name, entry.dist.version) if entry.dist is not None else ("", "")
        found.setdefault(entry.name, []).append(Addition(entry.name, entry.value, package, version))
    return found


def addition(group: str, what: str, name: str) -> Addition | None:
    """The addition of that name; None: nobody adds it. `what` it is, for messages.

    Raises ConfigError: several packages add one of that name.
    """
    found = additions(group).get(name, ())
    if len(found) > 1:
        raise ConfigError(
            f"{what} {name!r}: {' and '.join(each.origin for each in found)} both have one; uninstall one of them"
        )
    return found[0] if found else None


def load_addition(found: Addition, what: str) -> Any:
    """What stands there. Raises ConfigError: it cannot be imported; the message names it and its package."""
    return load(found.place, f"{what} {found.name!r} of {found.origin}")


def unusable(found: Addition, what: str, why: str) -> ConfigError:
    """The error for an addition that can be loaded but not used."""
    return ConfigError(f"{what} {found.name!r} of {found.origin} ({found.place}): {why}; mend that package")


def load(place: str, what: str) -> Any:
    """What stands at a place, "module:name". Raises ConfigError: it cannot be imported."""
    module, _, name = place.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (Exception, SystemExit) as error:  # whatever a package does when it is imported
        raise ConfigError(
            f"{what} ({place}): cannot be loaded: {type(error).__name__}: {error}; mend its package, or uninstall it"
        ) from error
