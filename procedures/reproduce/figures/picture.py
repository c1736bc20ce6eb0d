"""Drawings of the thesis' figures, and the canvas on which all of them are drawn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.thesis import contents
from palpate.procedures.showing.figure import write
from palpate.procedures.showing.text import STAMP

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colour of our curves by parameter set; the beam, which has one set, has a colour of its own.
COLORS = {"physical": "C0", "identified": "C1", "capped": "C2"}
BEAM_COLOR = "C2"
THESIS = "k"  # marks of the thesis are black and hollow
PANEL = (5.5, 4.0)  # inches


@dataclass(frozen=True, slots=True)
class SavedPicture:
    """A drawing on disk.

    Attributes:
        number: number of the figure or table in the thesis, such as "Figure 4.8".
        caption: what in it is the thesis' and what is ours, and which of ours is input, fitted or predicted.
        file: PNG file.
    """

    number: str
    caption: str
    file: Path

    @property
    def shows(self) -> str:
        """Content of the thesis' figure."""
        return contents()[self.number].shows


def canvas(number: str, panels: int = 1, simulated: bool = False) -> tuple[Figure, list[Axes]]:
    """An empty figure with its number as title, and its panels. `simulated`: it shows simulated measurements."""
    from matplotlib.figure import Figure

    width, height = PANEL
    figure = Figure(figsize=(width * panels, height), layout="constrained")
    title = figure.suptitle(f"{STAMP}: {number}" if simulated else number)
    if simulated:
        title.set_color("red")
    return figure, [figure.add_subplot(1, panels, place + 1) for place in range(panels)]


def legend(figure: Figure, columns: int = 2) -> None:
    """Draw one legend below all panels; equal labels appear once."""
    named = {
        label: handle for axes in figure.axes for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=columns, fontsize=8, frameon=False)
    # The figure grows by the legend, so that the panels keep their size.
    lines = -(-len(named) // columns)
    figure.set_figheight(PANEL[1] + 0.18 * lines)


def save(figure: Figure, number: str, caption: str, folder: Path) -> SavedPicture:
    """Write the drawing as PNG, named after its number. Raises RecordError."""
    kind, place = number.split()
    file = folder / f"{kind.lower()}_{place.replace('.', '_')}.png"
    write(figure, file, dpi=110)
    return SavedPicture(number, caption, file)
