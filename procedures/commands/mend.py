"""The commands palpate runs check, runs repair and runs install."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, Output, StrictCommand, option, output_options
from palpate.procedures.lab.store import store


@click.command(
    cls=StrictCommand, epilog="Examples:\n\n  palpate runs check first-day\n\n  palpate runs check first-day --json"
)
@click.argument("run")
@output_options
def check(run: str, as_json: bool, quiet: bool) -> int:
    """Check a run for damage without changing it. RUN is a folder or a name in runs/. Exit status 1: it is damaged.

    Every row has its own hash and the hash of the row before, and a second file holds the number of rows. So each lost
    or changed row is found. A run that has not ended is not damaged.
    """
    from palpate.procedures.records.damage import check as look_over
    from palpate.procedures.records.run import find_run
    from palpate.procedures.showing.runs import check_object, print_check

    output = Output(as_json, quiet)
    found = look_over(find_run(run, store()))
    output.result(lambda: check_object(found), lambda: print_check(found))
    return 1 if found.faults else 0


@click.command(cls=StrictCommand, epilog="Examples:\n\n  palpate runs repair first-day --out mended")
@click.argument("run")
@option("--out", required=True, type=FILE_NAME, metavar="DIR", help="Folder of the new run.")
@output_options
def repair(run: str, out: Path, as_json: bool, quiet: bool) -> None:
    """Salvage a damaged run into a new one, and say what is lost. RUN is a folder or a name; it is only read.

    All undamaged rows are found, wherever they lie in the damaged file. Header and last event of the new run say what
    is lost. A run that lost only its end can be resumed.
    """
    from palpate.procedures.records.damage import repair as salvage
    from palpate.procedures.records.run import find_run
    from palpate.procedures.showing.runs import print_repaired, repaired_object

    output = Output(as_json, quiet)
    done = salvage(find_run(run, store()), out)
    output.result(lambda: repaired_object(done), lambda: print_repaired(done))


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate runs install 20260102T030405Z-calibrate-load-cell"
    "\n\n  PALPATE_STORE=/other/store palpate runs install first-day --json",
)
@click.argument("run")
@output_options
def install(run: str, as_json: bool, quiet: bool) -> None:
    """Put the calibration of a run into the store, for later runs. RUN is a folder or a name in runs/.

    A run does this itself; it is left to you where the store was full or could not be written to. No bench is opened.
    What is in the store already stays as it is, and a newer calibration there is not replaced.
    """
    from datetime import UTC, datetime

    from palpate.procedures.lab.calibrations import install_of
    from palpate.procedures.records.run import Run, find_run

    output = Output(as_json, quiet)
    opened = Run.open(find_run(run, store()))
    path, done = install_of(opened, datetime.now(UTC).date())
    output.result(
        lambda: {"run": str(opened.folder), "calibration_file": str(path), "installed": done},
        lambda: output.line(f"{path}: {'is installed' if done else 'was installed already'}"),
    )
