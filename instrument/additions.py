"""Finds what installed packages add to palpate by entry points: device kinds, procedures, effects and designs.

A package declares an addition by its name in a group:

[project.entry-points."palpate.devices"]
acme-oven = "acme_oven:KIND"

A broken package causes an error only when its addition is used.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from palpate.instrument.errors import ConfigError, UnknownName, UsageError

# --- Libraries that come with an extra, not with palpate itself ----------------------------------------


def library(name: str, extra: str) -> Any:
    """The module `name`, which `palpate[extra]` brings. Raises UsageError: it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise UsageError(f"{name} cannot be imported ({error}); give: pip install 'palpate[{extra}]'") from None


# --- entry points of installed packages ----------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Addition:
    """One entry point.

    Attributes:
        name: its name in bench files, scenes and records.
        place: the object that it refers to, as "module:name".
        package: name of the package that adds it; empty: unknown.
        version: version of this package; empty: unknown.
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
    """All additions to a group of entry points, sorted by name; a name with several additions is a conflict."""
    from importlib.metadata import entry_points  # takes longer to import than many a command that has no use for it

    found: dict[str, list[Addition]] = {}
    for entry in sorted(entry_points(group=group), key=lambda entry: (entry.name, entry.value)):
        package, version = (entry.dist.name, entry.dist.version) if entry.dist is not None else ("", "")
        found.setdefault(entry.name, []).append(Addition(entry.name, entry.value, package, version))
    return found


def addition(group: str, what: str, name: str) -> Addition | None:
    """The addition with a name; None: there is none. `what` describes its kind in messages.

    Raises ConfigError: several packages add one with this name.
    """
    found = additions(group).get(name, ())
    if len(found) > 1:
        raise ConfigError(
            f"{what} {name!r}: {' and '.join(each.origin for each in found)} both have one; uninstall one of them"
        )
    return found[0] if found else None


def taken(group: str, what: str, ours: Iterable[str]) -> list[str]:
    """What is wrong with each addition that has the name of one of `ours`, palpate's own; `what` describes its kind."""
    return [
        f"{what} {name!r} of {each.origin}: palpate has one of that name; uninstall that package"
        for name in ours
        for each in additions(group).get(name, ())
    ]


def check_ours(group: str, what: str, ours: Iterable[str]) -> None:
    """Raises ConfigError: an installed package adds something with the name of one of `ours`, palpate's own."""
    if problems := taken(group, what, ours):
        raise ConfigError(problems[0])


def packages(group: str, what: str, names: Iterable[str]) -> dict[str, str]:
    """The installed packages that add these, with their versions; what nobody adds is palpate's own."""
    found = (addition(group, what, name) for name in names)
    return {entry.package: entry.version for entry in found if entry is not None}


def load_addition(found: Addition, what: str) -> Any:
    """The object of an addition. Raises ConfigError: it cannot be imported; the message names it and its package."""
    return load(found.place, f"{what} {found.name!r} of {found.origin}")


def find(group: str, what: str, name: str, ours: Iterable[str]) -> tuple[Addition, Any]:
    """The addition with a name that is not palpate's own, and its object.

    Args:
        group: group of entry points.
        what: kind of addition, for messages.
        name: its name.
        ours: the names of palpate's own, which a message offers besides.

    Raises:
        UnknownName: there is no such addition.
        ConfigError: several packages add one with this name, or it cannot be imported.
    """
    found = addition(group, what, name)
    if found is None:
        raise UnknownName(what, name, (*ours, *additions(group)))
    return found, load_addition(found, what)


def unusable(found: Addition, what: str, why: str) -> ConfigError:
    """The error for an addition that can be loaded but not used."""
    return ConfigError(f"{what} {found.name!r} of {found.origin} ({found.place}): {why}; mend that package")


def load(place: str, what: str) -> Any:
    """The object at a place "module:name". Raises ConfigError: it cannot be imported."""
    module, _, name = place.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except (Exception, SystemExit) as error:  # importing a package can raise anything
        raise ConfigError(
            f"{what} ({place}): cannot be loaded: {type(error).__name__}: {error}; mend its package, or uninstall it"
        ) from error
