"""The command palpate accuracy integrators."""

from __future__ import annotations

from pathlib import Path

import click

from palpate.procedures.commands.options import FILE_NAME, Output, StrictCommand, make_folder, option, output_options


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate accuracy integrators\n\n  palpate accuracy integrators --out prices --json",
)
@option("--out", type=FILE_NAME, metavar="DIR", help="Folder for the plot integrators.png (default: no plot).")
@output_options
def integrators(out: Path | None, as_json: bool, quiet: bool) -> None:
    """Measure error and time of methods that integrate a stiff chain in time; this takes about 5 s.

    The chain has nine states whose rates span six decades. It starts at rest, under a 10 Hz sine for 10 s. The error is
    the greatest error of the output over its greatest value, against a matrix exponential in extended precision. A
    second task is a Bouc-Wen operator, whose hysteresis is stiff under steps of x, over 3 cycles of the sine.
    """
    from palpate.instrument.notice import price
    from palpate.procedures.virtual.integrators import SECONDS, measure, plot_integrators, print_integrators, task

    output = Output(as_json, quiet)
    make_folder(out)
    with output.prices(), output.progress() as progress:
        price("following the chain by every method", SECONDS)
        rows = measure(progress)
    done = task()
    title = f"{done['states']} states, stiffness ratio {done['stiffness_ratio']:.0e}, {done['duration_s']:g} s record"
    plot = None if out is None else plot_integrators(rows, title, out)
    output.result(
        lambda: {**done, "methods": rows, "plot": None if plot is None else str(plot)},
        lambda: print_integrators(rows, title, plot),
    )
