"""Work-precision diagrams: error against the time of one answer, a panel for each design."""

from __future__ import annotations

from pathlib import Path

from palpate.instrument.models.prices.price import Price
from palpate.instrument.models.prices.price_list import PriceList
from palpate.instrument.quantity import show
from palpate.procedures.showing.figure import MARKERS, write

# The range of moduli of the rubber samples, in which every model answers.
INTERVAL = 1
PLOT = "models.png"


def plot_prices(prices: PriceList, designs: list[str], path: Path) -> None:
    """Draw a PNG file in an existing folder. A design without a reference has no panel.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    from matplotlib.figure import Figure

    references = {reference.design: reference for reference in prices.references if reference.design in designs}
    columns = min(2, len(references)) or 1
    rows = -(-len(references) // columns) or 1
    figure = Figure(figsize=(7.6 * columns, 4.6 * rows), layout="constrained")
    low, high = prices.moduli_Pa[INTERVAL : INTERVAL + 2]
    figure.suptitle(
        f"Greatest error of the force ratio for objects of {show(low, 'Pa', 3)} to {show(high, 'Pa', 3)}"
        f"\n{prices.machine.cpu}, {prices.machine.date}"
    )
    models = list(dict.fromkeys(price.model for price in prices.prices))
    for place, (design, reference) in enumerate(references.items()):
        ax = figure.add_subplot(rows, columns, place + 1)
        for number, model in enumerate(models):
            of_model = [p for p in prices.prices if (p.design, p.model) == (design, model)]
            points = [point for price in of_model if (point := _point(price))]
            label = model if points else f"{model}: no answer"
            style = f"C{number}{MARKERS[number % len(MARKERS)]}-"
            ax.plot([x for x, _ in points], [y for _, y in points], style, ms=6, lw=1, label=label)
        known = max(reference.uncertainties[INTERVAL : INTERVAL + 2])
        ax.axhline(known, color="0.5", ls=":", label="uncertainty of the reference")
        ax.set(
            xscale="log",
            yscale="log",
            title=design,
            xlabel="time of one answer; of a surface, among many (s)",
            ylabel="error",
        )
        ax.grid(alpha=0.3)
        ax.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    write(figure, path)


def _point(price: Price) -> tuple[float, float] | None:
    """Time and error of a price; None where one of them is missing."""
    error = price.errors[INTERVAL]
    return None if error is None or price.seconds is None else (price.seconds, error)
