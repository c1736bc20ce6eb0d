"""The commands palpate contracts: register maps of devices, exported, checked and made."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.instrument.errors import PalpateError, UsageError
from palpate.procedures.commands.options import FILE_NAME, Output, StrictGroup, option, output_options


@click.group(cls=StrictGroup)
def contracts() -> None:
    """Check, make and write the devices' register and object maps."""


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


@contracts.command(name="list", epilog="Examples:\n\n  palpate contracts list")
@output_options
def list_(as_json: bool, quiet: bool) -> None:
    """List the kinds of devices that a bench file can have."""
    from palpate.procedures.showing.maps import kind_rows, print_kinds

    output = Output(as_json, quiet)
    rows = kind_rows()
    output.result(lambda: {"kinds": rows}, lambda: print_kinds(rows))


@contracts.command(epilog="Examples:\n\n  palpate contracts check my_indicator.toml")
@click.argument("file", type=FILE_NAME)
@output_options
def check(file: Path, as_json: bool, quiet: bool) -> None:
    """Prove a map FILE of a maker's device by its frames, and by the maker's own EDS if PALPATE_EDS names its folder.

    Exit status 1: a frame does not fit.
    """
    from palpate.procedures.showing.maps import checked, print_checked

    output = Output(as_json, quiet)
    found = checked(file)
    output.result(found.summary, lambda: print_checked(found))
    if found.problems:
        raise PalpateError("\n".join(found.problems))


@contracts.command(epilog="Examples:\n\n  palpate contracts frames my_indicator.toml >> my_indicator.toml")
@click.argument("file", type=FILE_NAME)
@output_options
def frames(file: Path, as_json: bool, quiet: bool) -> None:
    """Print frames, worked out from a map FILE itself, for those of its fields that have none.

    Hold each against the manual before you put it into the map.
    """
    from palpate.instrument.contracts.maps.golden_frames import computed, prove
    from palpate.instrument.contracts.maps.map_file import read_map

    output = Output(as_json, quiet)
    found = read_map(file)
    tables = list(computed(found.contract, prove(found.contract, found.frames).without))
    if output.as_json:
        output.json({"file": str(file), "frames": tables})
    for table in tables:
        output.line(f"\n{table.rstrip()}")


@contracts.command(name="import", epilog="Examples:\n\n  palpate contracts import my.eds --object 6071 --out my.toml")
@click.argument("file", type=FILE_NAME)
@option("--out", required=True, type=FILE_NAME, metavar="FILE", help="Map file to write.")
@option("--object", "objects", multiple=True, metavar="INDEX[:SUB][=NAME]", help="Object, hexadecimal, as 6401:1=load.")
@option("--name", default="", help="Name of the device kind (default: made of the product's name).")
@option("--node", type=click.IntRange(1, 127), help="Node id as the device leaves the factory.")
@output_options
def import_(
    file: Path, out: Path, objects: tuple[str, ...], name: str, node: int | None, as_json: bool, quiet: bool
) -> None:
    """Make a map file from a maker's EDS or DCF FILE: its PDOs with their objects, and those that you name.

    What of the file a map cannot hold, and what in it contradicts itself, is told, and stands in the map as a comment.
    """
    from palpate.instrument.contracts.maps.eds import imported
    from palpate.procedures.records.run import storing

    output = Output(as_json, quiet)
    if out.exists():
        raise UsageError(f"--out {out}: is there already; name a new file, or delete it")
    notes: list[str] = []
    text = imported(file, objects, name, node, notes.append)
    with storing(out, "a writable file with --out"):
        out.write_text(text, encoding="utf-8")
    if output.as_json:
        output.json({"files": [str(out)], "notes": notes})
    for note in notes:
        output.line(note)
    output.line(str(out))
