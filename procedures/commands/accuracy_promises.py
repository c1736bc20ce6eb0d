"""The command palpate accuracy promises."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, Output, StrictCommand, option, output_options
from palpate.procedures.lab.store import store as usual


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate accuracy promises\n\n  palpate accuracy promises --store elsewhere --json",
)
@option("--store", type=FILE_NAME, metavar="DIR", help="Folder that holds the runs (default: runs/).")
@output_options
def promises_command(store: Path | None, as_json: bool, quiet: bool) -> None:
    """Compare what runs were predicted to take and to give with what they took and gave.

    Of each procedure whose runs are in the store: bench time over the predicted one, and the share of runs that ended
    within the printed bound, where the plan has one; and of each result, its standard uncertainty over the predicted
    one.
    """
    from palpate.instrument.errors import UsageError
    from palpate.procedures.accuracy.promises import promises
    from palpate.procedures.accuracy.promises_report import print_promises

    output, folder = Output(as_json, quiet), store or usual()
    if not folder.is_dir() and (store is not None or folder.exists()):
        raise UsageError(f"{folder} is no folder; name one that holds runs with --store")
    kept = promises(folder)
    found = {
        "store": str(folder),
        "procedures": [each.row() for each in kept.procedures],
        "runs": [each.row() for each in kept.runs],
        "without": kept.without,
        "unreadable": kept.unreadable,
    }
    output.result(lambda: found, lambda: print_promises(kept, folder))
