"""A package with a procedure of one's own, which passes its tests as it stands."""

from __future__ import annotations

from pathlib import Path

from palpate.instrument.additions import additions
from palpate.procedures.engine.catalogue import GROUP, SHIPPED
from palpate.procedures.templates.new_files import check_name, project_of, write_package


def new_procedure(name: str, folder: Path) -> list[Path]:
    """Write a package with a procedure into a new folder of that name; its runs have that name with dashes.

    Returns:
        Its pyproject.toml, module and test.

    Raises:
        UsageError: the name cannot be used, or the folder exists; nothing is written.
        RecordError: a file cannot be written.
    """
    check_name("procedure", name, (*SHIPPED, *additions(GROUP)))
    return write_package("procedure", name, folder, GROUP, project_of(name))
