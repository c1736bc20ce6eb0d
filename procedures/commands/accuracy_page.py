"""palpate accuracy, by itself."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from palpate.procedures.commands.accuracy_dwell import DEFAULT_SCENE, SAMPLES_PER_CYCLE, price
from palpate.procedures.commands.options import Output, make_folder

if TYPE_CHECKING:
    from palpate.procedures.accuracy.page import Part

DESIGN = "single"


def page(out: Path | None, output: Output) -> None:
    """Collect what is stored, measure the rest, and show it."""
    make_folder(out)
    parts = _collect(output)
    plot = None
    if out is not None:
        from palpate.procedures.accuracy.report import plot_page

        plot = plot_page(parts, out)
    if output.as_json:
        output.json({"parts": [part.summary() for part in parts], "plot": None if plot is None else str(plot)})
    elif output.for_people:
        from palpate.procedures.accuracy.report import print_page

        print_page(parts, plot)


def _collect(output: Output) -> list[Part]:
    from palpate.instrument.models.prices.price_list import stored
    from palpate.procedures.accuracy import arithmetic
    from palpate.procedures.accuracy.page import of_arithmetic, of_dwells, of_integrators, of_models
    from palpate.simulators.linear.integrators import compare
    from palpate.simulators.planning.plan import Question

    with output.progress("time integration") as progress:
        integrated = []
        for done in compare():
            integrated.append(done)
            progress(len(integrated), 0, done.method)
        progress(0, 0, "dwell")
        question = Question()
        dwells = price(DEFAULT_SCENE, None, question, SAMPLES_PER_CYCLE * question.frequency)
        progress(0, 0, "arithmetic")
        measured = list(arithmetic.measure())
    return [
        of_models(stored(), DESIGN),
        of_integrators(integrated),
        of_dwells(dwells, DEFAULT_SCENE),
        *of_arithmetic(measured),
    ]
