"""Work-precision diagrams: error against the time of one answer, a panel for each design."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.models.price_list import PriceList
from palpate.instrument.quantity import show
from palpate.procedures.showing.figure import MARKERS, write

if TYPE_CHECKING:
    from matplotlib.artist import Artist

# The range of moduli of the rubber samples, in which every model answers.
INTERVAL = 1
MODELS_PLOT = "models.png"
REFERENCE = "uncertainty of the reference"


def plot_prices(prices: PriceList, designs: list[str], path: Path) -> None:
    """Draw a PNG file in an existing folder. A design without a reference has no panel.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    from matplotlib.figure import Figure

    references = {reference.design: reference for reference in prices.references if reference.design in designs}
    columns = min(2, len(references)) or 1
    rows = -(-len(references) // columns) or 1
    figure = Figure(figsize=(5.6 * columns + 2, 4.4 * rows), layout="constrained")
    low, high = prices.moduli_Pa[INTERVAL : INTERVAL + 2]
    figure.suptitle(
        f"Greatest error of the force ratio for objects of {show(low, 'Pa', 3)} to {show(high, 'Pa', 3)}"
        f"\n{prices.machine.cpu}, {prices.machine.date}"
    )
    models = list(dict.fromkeys(price.model for price in prices.prices))
    drawn: dict[str, Artist] = {}
    for place, (design, reference) in enumerate(references.items()):
        ax = figure.add_subplot(rows, columns, place + 1)
        for number, model in enumerate(models):
            style = f"C{number}{MARKERS[number % len(MARKERS)]}"
            own = [
                p for p in prices.prices if (p.design, p.model) == (design, model) and p.errors[INTERVAL] is not None
            ]
            answers = [(p.answer_s, p.errors[INTERVAL]) for p in own if p.answer_s is not None]
            meshes = [(p.seconds, p.errors[INTERVAL]) for p in own if p.answer_s is None and p.seconds is not None]
            for points, kind in ((answers, {"ls": "-", "lw": 1}), (meshes, {"ls": "", "mfc": "none"})):
                if points:
                    (line,) = ax.plot(*zip(*points, strict=True), style, ms=6, **kind)
                    drawn.setdefault(model, line)
        known = max(reference.uncertainties[INTERVAL : INTERVAL + 2])
        drawn[REFERENCE] = ax.axhline(known, color="0.5", ls=":")
        ax.set(xscale="log", yscale="log", title=design, xlabel="processor time of one answer (s)", ylabel="error")
        ax.grid(alpha=0.3)
    # One legend for all panels. Of a hollow point the time is that of one mesh, which callers do not get alone.
    names = [name for name in (*models, REFERENCE) if name in drawn]
    figure.legend(
        [drawn[name] for name in names], names, loc="outside right upper", fontsize=8, title="hollow: one mesh alone"
    )
    write(figure, path)
