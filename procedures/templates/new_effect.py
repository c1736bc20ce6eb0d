"""A package with an effect of one's own: it passes the conformance suite of effects as it stands."""

from __future__ import annotations

from pathlib import Path

from palpate.instrument.errors import UsageError
from palpate.procedures.templates.new_files import check_name, write_package
from palpate.procedures.virtual.explained import GROUP, effect_names


def new_effect(name: str, folder: Path) -> list[Path]:
    """Write a package with an effect into a new folder of that name; scenes call for it by the same name.

    Returns:
        Its pyproject.toml, module and test.

    Raises:
        UsageError: the name cannot be used, or the folder exists; nothing is written.
        RecordError: a file cannot be written.
    """
    check_name("effect", name, effect_names())
    if any(word[0].isdigit() for word in name.split("_")):  # scenes know it by its class, which has no underscores
        raise UsageError(f"{name!r}: a word of an effect's name begins with a letter; write {_joined(name)!r}")
    return write_package("effect", name, folder, GROUP, name)


def _joined(name: str) -> str:
    """The name with words of digits joined to the ones before them."""
    first, *words = name.split("_")
    return first + "".join(word if word[0].isdigit() else f"_{word}" for word in words)
