"""The command palpate contracts export."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, Group, Output, option, output_options


@click.group(cls=Group)
def contracts() -> None:
    """Write the devices' register and object maps."""


@contracts.command(epilog="Examples:\n\n  palpate contracts export --to maps")
@option("--to", "folder", required=True, type=FILE_NAME, metavar="DIR", help="Folder for the files.")
@output_options
def export(folder: Path, as_json: bool, quiet: bool) -> None:
    """Write the register tables (Markdown), the sensor node's EDS, and a DBC for logging tools."""
    from palpate.instrument.bench.kinds import all_kinds
    from palpate.instrument.contracts.export import export_contracts

    output = Output(as_json, quiet)
    files = export_contracts(folder, [kind.contract for kind in all_kinds()])
    if output.as_json:
        output.json({"files": [str(file) for file in files]})
    for file in files:
        output.line(str(file))
