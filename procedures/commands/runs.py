"""The commands palpate runs list, runs show and runs export."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.mend import check, install, repair
from palpate.procedures.commands.options import FILE_NAME, Output, StrictGroup, option, output_options
from palpate.procedures.commands.resume import resume
from palpate.procedures.lab.store import store


@click.group(cls=StrictGroup)
def runs() -> None:
    """Look at recorded runs, resume them, repair them, install their calibrations."""


for command in (resume, check, repair, install):
    runs.add_command(command)


@runs.command("list", epilog="Examples:\n\n  palpate runs list\n\n  palpate runs list --out elsewhere --json")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder that holds the runs.")
@output_options
def list_(out: Path | None, as_json: bool, quiet: bool) -> None:
    """List the runs in runs/, newest first."""
    from palpate.instrument.errors import UsageError
    from palpate.procedures.records.run import list_runs
    from palpate.procedures.showing.runs import print_runs, run_row

    output = Output(as_json, quiet)
    folder = out or store()
    if not folder.is_dir() and (out is not None or folder.exists()):
        raise UsageError(f"{folder} is no folder; name one that holds runs with --out")
    found = list_runs(folder)
    output.result(lambda: {"runs": [run_row(run) for run in found]}, lambda: print_runs(found, folder))


@runs.command(
    epilog="Examples:\n\n  palpate runs show 20260102T030405Z-sweep-loads\n\n  palpate runs show first-day --json"
)
@click.argument("run")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder that holds the runs.")
@output_options
def show(run: str, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Show a run: its settings, its points, its events. RUN is a folder or a name in runs/.

    Every row is checked against its hash. Runs with the same measured values have the same digest. The
    digest of signals counts settings, times and waveforms alone, and is the same by any arithmetic.
    """
    from palpate.procedures.records.run import Run, find_run
    from palpate.procedures.showing.runs import print_run, run_object

    output = Output(as_json, quiet)
    opened = Run.open(find_run(run, out or store()))
    digests = opened.digest(), opened.signal_digest()
    output.result(lambda: run_object(opened, *digests), lambda: print_run(opened, *digests))


@runs.command(
    epilog="Examples:\n\n  palpate runs export first-day\n\n  palpate runs export first-day --to parquet --out tables"
)
@click.argument("run")
@option("--to", type=click.Choice(["csv", "parquet"]), default="csv", help="Format.")
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the files (default: that of the run).")
@output_options
def export(run: str, to: str, out: Path | None, as_json: bool, quiet: bool) -> None:
    """Export points and waveforms of a run as tables. RUN is a folder or a name in runs/."""
    from palpate.procedures.records.export import export as export_run
    from palpate.procedures.records.run import Run, find_run

    output = Output(as_json, quiet)
    opened = Run.open(find_run(run, store()))
    files = export_run(opened, to, out or opened.folder)
    if output.as_json:
        about = {"run": str(opened.folder), "simulated": opened.simulated}
        output.json({**about, "files": [str(file) for file in files]})
    for file in files:
        output.line(str(file))
