"""The commands palpate new bench, new design, new device, new effect and new procedure."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, Output, StrictGroup, option, output_options

PACKAGE = """
Install it, and run its tests, which pass as they stand:

  pip install -e {folder}
  pytest {folder}

"""
DEVICE = "Then put in what the device's manual says, with a golden frame for each field: see docs/how-to/device.md."
EFFECT = "Then put in your physics, and let a scene call for it: see docs/how-to/effect.md."
PROCEDURE = "Then put in your measurement: see docs/how-to/procedure.md."
DESIGN = "Then put in your sensor's dimensions, materials and films: the comments in its file say what each is."
BENCH = """
Its tests pass as they stand, on its simulated bench:

  pytest {folder}

Then put in the addresses of your devices: see docs/how-to/test.md."""

FOLDER = option(
    "--to", "folder", type=FILE_NAME, default=Path(), show_default=False, metavar="DIR", help="Folder (default: here)."
)


@click.group(cls=StrictGroup)
def new() -> None:
    """Begin something of your own: a folder with tests that pass as they stand."""


@new.command(
    epilog="Examples:\n\n  palpate new device force_gauge --kind sensor\n\n  palpate new device oven --bus canopen"
)
@click.argument("name")
@option("--bus", type=click.Choice(["modbus-tcp", "modbus-rtu", "canopen"]), default="modbus-tcp")
@option(
    "--kind", type=click.Choice(["actuator", "sensor", "registers"]), default="actuator",
    help="What it begins as; registers: a register map and nothing else.",
)  # fmt: skip
@FOLDER
@output_options
def device(name: str, bus: str, kind: str, folder: Path, as_json: bool, quiet: bool) -> None:
    """Write a package with contract, driver, simulator, golden frames and test of a device."""
    from palpate.procedures.templates.new_files import new_device

    _tell(new_device(name, bus, kind, folder), PACKAGE + DEVICE, Output(as_json, quiet))


def _package(kind: str, example: str, then: str, text: str) -> None:
    """A command that writes a package with something of a kind."""

    @new.command(kind, help=text, epilog=f"Examples:\n\n  palpate new {kind} {example}")
    @click.argument("name")
    @FOLDER
    @output_options
    def package(name: str, folder: Path, as_json: bool, quiet: bool) -> None:
        from palpate.procedures.templates.new_files import new_package

        _tell(new_package(kind, name, folder), PACKAGE + then, Output(as_json, quiet))


_package(
    "design",
    "grasper_7",
    DESIGN,
    "Write a package with a sensor design that scenes and bench files can name, and its test.",
)
_package("effect", "cable_sag", EFFECT, "Write a package with an effect that scenes can call for, and its test.")
_package("procedure", "repeatability", PROCEDURE, "Write a package with a procedure on the bench, and its test.")


@new.command(epilog="Examples:\n\n  palpate new bench lab_2\n\n  palpate new bench lab_2 --device sample_changer")
@click.argument("name")
@option(
    "--device",
    "kinds",
    multiple=True,
    metavar="KIND",
    help="Kind of a further device of the bench; repeat it for more.",
)
@FOLDER
@output_options
def bench(name: str, kinds: tuple[str, ...], folder: Path, as_json: bool, quiet: bool) -> None:
    """Write a folder with a bench file, the scene that stands in for it, and tests for both and for CI."""
    from palpate.procedures.templates.new_files import new_bench

    _tell(new_bench(name, kinds, folder), BENCH, Output(as_json, quiet))


def _tell(files: list[Path], then: str, output: Output) -> None:
    if output.as_json:
        output.json({"files": [str(file) for file in files]})
    for file in files:
        output.line(str(file))
    output.line(then.format(folder=files[0].parent))
