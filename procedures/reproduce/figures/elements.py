"""Figure 4.5: the elements of our two finite-element models, with a dot for each shape function."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.procedures.reproduce.figures.picture import Picture, canvas, legend, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NUMBER = "Figure 4.5"
DEGREE = 3
OF = ("a corner", "a side", "a face", "the inside")  # by the number of a dot's coordinates that are not at an end
COLORS = ("k", "C0", "C1", "C2")
VIEW = np.array([[1.0, 0.0], [0.45, 0.35], [0.0, 1.0]])  # directions of the brick's axes on paper


def draw(folder: Path) -> Picture:
    """Draw a rectangle of the round model and a brick of the square one. Raises RecordError."""
    drawing, (flat, brick) = canvas(NUMBER, 2)
    _draw(flat, np.eye(2))
    _draw(brick, VIEW)
    flat.set_title("model axisymmetric: rectangle in the section", fontsize=10)
    brick.set_title("model solid: quadrilateral of the plan, along the height", fontsize=10)
    legend(drawing, columns=4)
    caption = (
        f"Ours, in the place of the thesis' four kinds: two shapes, here of degree {DEGREE}, with a dot for each shape"
        " function of a displacement. Soft bodies have pressures within each element besides, so that rubber does not"
        " lock. Films are such elements, too; their voltage is one unknown each."
    )
    return save(drawing, NUMBER, caption, folder)


def _draw(axes: Axes, view: np.ndarray) -> None:
    """Draw a unit square or cube; `view` turns its coordinates into those on paper."""
    size = len(view)
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=size)))
    for one, other in itertools.combinations(corners, 2):
        if np.abs(one - other).sum() == 1:
            axes.plot(*np.array([one @ view, other @ view]).T, color="0.6", lw=1.0, zorder=0)
    dots = np.array(list(itertools.product(np.linspace(0, 1, DEGREE + 1), repeat=size)))
    within = ((dots > 0) & (dots < 1)).sum(axis=1)
    # A rectangle has one coordinate less than a brick, so its inside counts as a face.
    for kind in range(size + 1):
        x, y = (dots[within == kind] @ view).T
        axes.plot(x, y, "o", color=COLORS[kind], ms=5, label=f"of {OF[kind]}")
    axes.set(aspect="equal")
    axes.margins(0.08)
    axes.axis("off")
