"""A package with a sensor design of one's own: a simulated bench measures with it as it stands."""

from __future__ import annotations

from pathlib import Path

from palpate.instrument.additions import additions
from palpate.instrument.sensor.designs import DESIGNS, GROUP
from palpate.procedures.templates.new_files import check_name, write_package


def new_design(name: str, folder: Path) -> list[Path]:
    """Write a package with a sensor design into a new folder of that name; scenes and bench files name it so.

    Returns:
        Its pyproject.toml, module and test.

    Raises:
        UsageError: the name cannot be used, or the folder exists; nothing is written.
        RecordError: a file cannot be written.
    """
    check_name("design", name, (*DESIGNS, *additions(GROUP)))
    return write_package("design", name, folder, GROUP, name, "DESIGN")
