"""The command palpate history."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import WHERE, Output, StrictCommand, option, output_options, picture_option
from palpate.procedures.lab.store import store


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate history sensitivity --tolerance '0.5 %' --out cell.svg"
    "\n\n  palpate history 'force ratio of sample 1' --where 'simulated = false' --json",
)
@click.argument("quantity")
@WHERE
@option("--tolerance", help="Change that is allowed, such as '1 %' or '0.1 mV/N' (default: the u of the last run).")
@picture_option("no picture")
@output_options
def history(
    quantity: str, where: tuple[str, ...], tolerance: str | None, out: Path | None, as_json: bool, quiet: bool
) -> None:
    """Show how QUANTITY changed over the complete runs in runs/: control charts, drift, and when to calibrate again.

    QUANTITY is a column of the points or the quantity of a budget, as in a file of limits. Each bench, its devices,
    each object and each kind of run with its settings has a history of its own. An alarm says that a value differs from
    those before it by more than the uncertainties of both explain.
    """
    from datetime import UTC, datetime

    from palpate.procedures.engine.history import history as found_in
    from palpate.procedures.lab.run_table import chosen
    from palpate.procedures.records.run import check_new, list_runs
    from palpate.procedures.showing.figure import FORMATS
    from palpate.procedures.showing.history import plot_history, print_history

    output = Output(as_json, quiet)
    check_new(out, FORMATS)
    runs = [run for run, _ in chosen(list_runs(store()), where)]
    found = found_in(runs, quantity, tolerance, datetime.now(UTC))
    if out is not None:
        plot_history(found, out)
    picture = None if out is None else str(out.absolute())
    output.result(lambda: {**found.summary(), "picture": picture}, lambda: print_history(found, picture))
