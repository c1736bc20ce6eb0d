"""The command palpate accuracy without a subcommand."""

from __future__ import annotations

from pathlib import Path

from palpate.procedures.commands.options import Output, make_folder


def page(out: Path | None, output: Output) -> None:
    """Collect the stored results, measure the others, and show all."""
    from palpate.procedures.virtual.page import collect

    make_folder(out)
    with output.progress("time integration") as progress:
        parts = collect(progress)
    plot = None
    if out is not None:
        from palpate.procedures.accuracy.report import plot_page

        plot = plot_page(parts, out)
    if output.as_json:
        output.json({"parts": [part.summary() for part in parts], "plot": None if plot is None else str(plot)})
    elif output.for_people:
        from palpate.procedures.accuracy.report import print_page

        print_page(parts, plot)
