"""The commands palpate new device, new effect and new procedure."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, Group, Output, option, output_options

NEXT = """
They pass as they stand: pytest {test}
{then}"""
PACKAGE = """Install the package first (pip install -e), so that palpate finds it. Then put in what the device's manual
says, with a golden frame for each register: see docs/how-to/device.md."""
DEVICE = """Then put in what the device's manual says, with a golden frame for each register or object, and let it
stand on the bench: see docs/how-to/device.md."""
EFFECT = """Then put in your physics, and a line each in EFFECTS (simulators/effects/__init__.py), at its place in the
chain, and in STRONG (tests/simulators/strong.py): then every test of the effects holds for it, too."""
PROCEDURE = """Then put in your measurement; for a command of its own copy procedures/commands/test.py."""

TREE = option(
    "--to",
    "tree",
    type=FILE_NAME,
    default=Path(),
    show_default=False,
    metavar="DIR",
    help="Source tree (default: here).",
)


@click.group(cls=Group)
def new() -> None:
    """Begin something of your own."""


@new.command(epilog="Examples:\n\n  palpate new device force_gauge\n\n  palpate new device oven --bus canopen")
@click.argument("name")
@option("--bus", type=click.Choice(["modbus-tcp", "modbus-rtu", "canopen"]), default="modbus-tcp")
@TREE
@output_options
def device(name: str, bus: str, tree: Path, as_json: bool, quiet: bool) -> None:
    """Write contract, driver, simulator, golden frames and test of a device, which pass as they stand.

    In a source tree of palpate they go to their places there. Anywhere else they make a package of their own, which is
    installed beside palpate (of a Modbus device).
    """
    from palpate.procedures.templates.new_device import MODBUS, new_device, new_package

    if bus in MODBUS and not (tree / "instrument" / "contracts").is_dir():
        _tell(new_package(name, bus, tree), PACKAGE, Output(as_json, quiet))
    else:
        _tell(new_device(name, bus, tree), DEVICE, Output(as_json, quiet))


@new.command(epilog="Examples:\n\n  palpate new effect cable_sag")
@click.argument("name")
@TREE
@output_options
def effect(name: str, tree: Path, as_json: bool, quiet: bool) -> None:
    """Write an effect that scenes can call for, and its test, which pass as they stand."""
    from palpate.procedures.templates.new_files import new_effect

    _tell(new_effect(name, tree), EFFECT, Output(as_json, quiet))


@new.command(epilog="Examples:\n\n  palpate new procedure repeatability")
@click.argument("name")
@TREE
@output_options
def procedure(name: str, tree: Path, as_json: bool, quiet: bool) -> None:
    """Write a procedure on the bench, and its test, which pass as they stand."""
    from palpate.procedures.templates.new_files import new_procedure

    _tell(new_procedure(name, tree), PROCEDURE, Output(as_json, quiet))


def _tell(files: list[Path], then: str, output: Output) -> None:
    if output.as_json:
        output.json({"files": [str(file) for file in files]})
    for file in files:
        output.line(str(file))
    output.line(NEXT.format(test=files[-1], then=then))
