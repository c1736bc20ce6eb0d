"""palpate new."""

from __future__ import annotations

from pathlib import Path

import click

from procedures.cli.options import FILE_NAME, Output, output_options

NEXT = """
They pass as they stand: pytest {test}
Then put in the registers of the device's manual, with a golden frame for each, and let it stand on the bench:
see "Adding a device" in the README."""


@click.group()
def new() -> None:
    """Begin something of your own."""


@new.command(epilog="Examples:\n\n  palpate new device force_gauge\n\n  palpate new device oven --bus modbus-rtu")
@click.argument("name")
@click.option("--bus", type=click.Choice(["modbus-tcp", "modbus-rtu"]), default="modbus-tcp", show_default=True)
@click.option("--to", "tree", type=FILE_NAME, default=Path(), metavar="DIR", help="Source tree (default: here).")
@output_options
def device(name: str, bus: str, tree: Path, as_json: bool, quiet: bool) -> None:
    """Write contract, driver, simulator, golden frames and test of a device, which pass as they stand."""
    from procedures.new_device import new_device

    output = Output(as_json, quiet)
    files = new_device(name, bus, tree)
    if output.as_json:
        output.json({"files": [str(file) for file in files]})
    for file in files:
        output.line(str(file))
    output.line(NEXT.format(test=files[-1]))
