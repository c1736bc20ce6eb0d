"""A drawing of a figure of the thesis, and the canvas that all of them are drawn on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.thesis import contents
from palpate.procedures.records.run import storing
from palpate.procedures.showing.text import STAMP

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Parameter set -> colour of what is ours by it; the beam has one set, and a colour of its own.
COLORS = {"physical": "C0", "identified": "C1", "capped": "C2"}
BEAM_COLOR = "C2"
THESIS = "k"  # marks of the thesis are black and hollow
PANEL = (5.5, 4.0)  # inches


@dataclass(frozen=True, slots=True)
class Picture:
    """A drawing on disk.

    Attributes:
        number: of the figure or table in the thesis, such as "Figure 4.8".
        caption: what in it is the thesis' and what ours, and of ours what is input, fitted or predicted.
        file: PNG.
    """

    number: str
    caption: str
    file: Path

    @property
    def shows(self) -> str:
        """What the thesis' figure shows."""
        return contents()[self.number].shows


def canvas(number: str, panels: int = 1, simulated: bool = False) -> tuple[Figure, list[Axes]]:
    """An empty figure with its number for a title, and its panels; `simulated`: it holds what was measured so."""
    from matplotlib.figure import Figure

    width, height = PANEL
    figure = Figure(figsize=(width * panels, height), layout="constrained")
    title = figure.suptitle(f"{STAMP}: {number}" if simulated else number)
    if simulated:
        title.set_color("red")
    return figure, [figure.add_subplot(1, panels, place + 1) for place in range(panels)]


def legend(figure: Figure, columns: int = 2) -> None:
    """One legend of all panels, below them: what several name alike stands there once."""
    named = {
        label: handle for axes in figure.axes for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=columns, fontsize=8, frameon=False)
    # Room for the legend does not come out of the panels.
    lines = -(-len(named) // columns)
    figure.set_figheight(PANEL[1] + 0.18 * lines)


def save(figure: Figure, number: str, caption: str, folder: Path) -> Picture:
    """Write the drawing as PNG, named after its number. Raises RecordError."""
    kind, place = number.split()
    file = folder / f"{kind.lower()}_{place.replace('.', '_')}.png"
    with storing(file):
        figure.savefig(file, dpi=110, metadata={"Software": None})
    return Picture(number, caption, file)
