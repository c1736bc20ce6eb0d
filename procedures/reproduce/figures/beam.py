"""Figures 4.2 and 4.3: half of the sensor as a beam on two foundations, and its elements with their unknowns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.instrument.sensor.designs import get_design
from palpate.procedures.reproduce.figures.picture import Picture, canvas, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MM = 1e3
BEAM, SPRING = 1.0, 0.8  # heights in the drawing
COLORS = {"object": "C3", "ring": "0.35"}


def draw_springs(folder: Path) -> Picture:
    """Draw Figure 4.2. Raises RecordError."""
    drawing, (axes,) = canvas("Figure 4.2")
    first, second = _lengths()
    _draw_beam(axes)
    for x in np.arange(0.35, first + second, 0.7):
        axes.annotate("", (x, BEAM + 0.12), (x, BEAM + 0.5), arrowprops={"arrowstyle": "->", "lw": 0.8})
    axes.text((first + second) / 2, BEAM + 0.56, "uniform load", ha="center", fontsize=9)
    over_tooth, over_ring = np.linspace(0.2, first - 0.2, 3), np.linspace(first + 0.3, first + second - 0.2, 6)
    for x in over_tooth:
        _draw_spring(axes, x, 0.0, BEAM - 0.06, "object")
    for x in over_ring:
        _draw_spring(axes, x, 0.0, BEAM - 0.06, "object")
        _draw_spring(axes, x, -SPRING, 0.0, "ring")
    axes.plot([0, first], [0, 0], "k", lw=3)
    axes.plot([first, first + second], [-SPRING, -SPRING], "k", lw=3)
    axes.text(first / 2, -0.25, "rigid tooth", ha="center", fontsize=9)
    axes.plot([], [], color=COLORS["object"], label="object")
    axes.plot([], [], color=COLORS["ring"], label="ring")
    axes.axvline(0, color="0.6", ls="-.", lw=0.8)
    axes.text(0.03, BEAM + 0.65, "axis", fontsize=8, color="0.4")
    axes.legend(fontsize=8, loc="lower left", frameon=False, bbox_to_anchor=(0.02, 0.02))
    axes.set(xlim=(-0.4, first + second + 0.4), ylim=(-SPRING - 0.15, BEAM + 0.8))
    axes.axis("off")
    caption = (
        "A scheme of ours after section 4.1, lengths to scale: the tissue is a beam; above the tooth the object's own"
        " spring carries it, above the ring those of object and ring in series. Models beam, beam_exact, beam_printed."
    )
    return save(drawing, "Figure 4.2", caption, folder)


def draw_elements(folder: Path) -> Picture:
    """Draw Figure 4.3. Raises RecordError."""
    drawing, (axes,) = canvas("Figure 4.3")
    first, second = _lengths()
    _draw_beam(axes)
    for number, x in enumerate((0.0, first, first + second), start=1):
        axes.plot([x], [BEAM], "ko", ms=6)
        axes.annotate("", (x, BEAM + 0.55), (x, BEAM + 0.1), arrowprops={"arrowstyle": "->", "lw": 1.2, "color": "C0"})
        axes.annotate(
            "", (x + 0.28, BEAM - 0.2), (x - 0.28, BEAM - 0.2),
            arrowprops={"arrowstyle": "->", "lw": 1.2, "color": "C1", "connectionstyle": "arc3,rad=0.6"},
        )  # fmt: skip
        axes.text(x, BEAM + 0.6, f"u{number}", ha="center", fontsize=10, color="C0")
        axes.text(x, BEAM - 0.5, f"θ{number}", ha="center", va="top", fontsize=10, color="C1")
    for start, length, number in ((0.0, first, 1), (first, second, 2)):
        words = f"element {number}\nL{number} = {length:g} mm"
        axes.text(start + length / 2, BEAM + 0.1, words, ha="center", fontsize=9)
    axes.set(xlim=(-0.5, first + second + 0.5), ylim=(BEAM - 0.8, BEAM + 0.8))
    axes.axis("off")
    caption = (
        "A scheme of ours after section 4.1: two elements with deflection u and slope θ at each node, in the program's"
        " lengths. Model beam_printed; beam cuts the same beam into more elements."
    )
    return save(drawing, "Figure 4.3", caption, folder)


def _lengths() -> tuple[float, float]:
    """Lengths of the beam above tooth and ring [mm], as the program of Appendix A2.1 has them."""
    sensor = get_design("single")
    return MM * sensor.tooth.radius, round(MM * (sensor.ring.outer_radius - sensor.ring.inner_radius), 6)


def _draw_beam(axes: Axes) -> None:
    first, second = _lengths()
    axes.plot([0, first + second], [BEAM, BEAM], color="#c0785a", lw=7, solid_capstyle="butt")


def _draw_spring(axes: Axes, x: float, low: float, high: float, of: str) -> None:
    turns = 7
    heights = np.linspace(low, high, turns + 2)
    sides = np.array([0.0, *(0.06 * (-1) ** n for n in range(turns)), 0.0])
    axes.plot(x + sides, heights, color=COLORS[of], lw=1.1)
