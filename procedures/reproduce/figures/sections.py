"""Figures 4.1a, 4.9 and 4.11a: plan and section of the three sensors, to scale, from their designs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from instrument.design import Design
from instrument.designs import get_design
from instrument.models.parameter_sets import PHYSICAL
from procedures.reproduce.figures.picture import Picture, canvas, legend, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SENSORS = {"Figure 4.1a": "single", "Figure 4.9": "different_base", "Figure 4.11a": "common_base"}
MM = 1e3
COLORS = {"object": "#f2cfc0", "ring": "0.35", "tooth": "#e8e2c8", "plate": "#bcd7ea", "film": "C3"}
SLIT = 0.04  # mm on either side of the cut between bases that stand side by side
DIMENSION = {"arrowstyle": "<->", "lw": 0.8, "shrinkA": 0, "shrinkB": 0}


def draw(number: str, folder: Path) -> Picture:
    """Plan and section of one of SENSORS. Raises RecordError."""
    design = get_design(SENSORS[number])
    drawing, (plan, section) = canvas(number, 2)
    _draw_plan(plan, design)
    _draw_section(section, design)
    length, width = _size(design)
    plan.set_ylim(-2.0, width + 2.0)
    section.set_ylim(-2.0, width + 2.0)
    for axes in (plan, section):
        axes.set(aspect="equal", xlim=(-3.5, length + 0.5))
        axes.axis("off")
    plan.set_title("plan", fontsize=10)
    section.set_title("section through the axes of the teeth" if len(design.teeth) > 1 else "section", fontsize=10)
    legend(drawing, columns=5)
    films = f"{len(design.films)} films of {1e6 * design.film_sheet.thickness:g} µm, drawn as lines"
    caption = (
        f"Design {design.name}, drawn to scale from its own numbers in mm (input: {design.source}); {films}. The object"
        f" above is the samples' {MM * PHYSICAL.sensed_thickness:g} mm."
    )
    return save(drawing, number, caption, folder)


def _draw_plan(axes: Axes, design: Design) -> None:
    from matplotlib.patches import Circle, Rectangle

    for x, y, length, width in _bases(design):
        axes.add_patch(Rectangle((x, y), length, width, fc=COLORS["plate"], ec="k", lw=0.8))
    ring, tooth = design.ring, design.tooth
    for x, y in design.teeth:
        centre = (MM * x, MM * y)
        axes.add_patch(Circle(centre, MM * ring.outer_radius, fc=COLORS["ring"], ec="k", lw=0.6))
        axes.add_patch(Circle(centre, MM * ring.inner_radius, fc=COLORS["plate"], ec="k", lw=0.6))
        axes.add_patch(Circle(centre, MM * tooth.radius, fc=COLORS["tooth"], ec="k", lw=0.6))
    length, width = _size(design)
    _across(axes, 0.0, length, -1.4, f"{length:g}")
    _up(axes, 0.0, width, -1.2, f"{width:g}")
    if len(design.teeth) > 1:
        _across(
            axes,
            MM * design.teeth[0][0],
            MM * design.teeth[1][0],
            width + 0.5,
            f"{MM * (design.teeth[1][0] - design.teeth[0][0]):g}",
        )


def _draw_section(axes: Axes, design: Design) -> None:
    from matplotlib.patches import Rectangle

    ring, tooth, plate = design.ring, design.tooth, design.plate
    t = MM * plate.thickness
    base, top = design.plate_count * t, design.plate_count * t + MM * max(ring.height, tooth.height)
    for x, _, length, _ in _bases(design):
        for number in range(design.plate_count):
            axes.add_patch(
                Rectangle(
                    (x, number * t),
                    length,
                    t,
                    fc=COLORS["plate"],
                    ec="k",
                    lw=0.6,
                    label=_once("base plates", x, number),
                )
            )
        axes.plot(
            [x, x + length], [t, t], color=COLORS["film"], lw=2.5, solid_capstyle="butt", label=_once("films", x, 0)
        )
    for x in (MM * place for place, _ in design.teeth):
        for side in (-1, 1):
            inner, outer = sorted((x + side * MM * ring.inner_radius, x + side * MM * ring.outer_radius))
            axes.add_patch(
                Rectangle(
                    (inner, base), outer - inner, MM * ring.height, fc=COLORS["ring"], ec="k", lw=0.6,
                    label=_once("compliant ring", x - MM * design.teeth[0][0], side + 1),
                )
            )  # fmt: skip
        r = MM * tooth.radius
        axes.add_patch(
            Rectangle(
                (x - r, base),
                2 * r,
                MM * tooth.height,
                fc=COLORS["tooth"],
                ec="k",
                lw=0.6,
                label=_once("rigid tooth", x - MM * design.teeth[0][0], 0),
            )
        )
        axes.plot([x - r, x + r], [base, base], color=COLORS["film"], lw=2.5, solid_capstyle="butt")
    length, _ = _size(design)
    sensed = MM * PHYSICAL.sensed_thickness
    axes.add_patch(Rectangle((0, top), length, sensed, fc=COLORS["object"], ec="k", lw=0.6, label="object"))
    first = MM * design.teeth[0][0]
    _across(
        axes, first - MM * tooth.radius, first + MM * tooth.radius, top + 0.3 * sensed, f"⌀ {2 * MM * tooth.radius:g}"
    )
    _across(
        axes,
        first - MM * ring.outer_radius,
        first + MM * ring.outer_radius,
        -1.2,
        f"⌀ {2 * MM * ring.outer_radius:g}, inside {2 * MM * ring.inner_radius:g}",
    )
    _up(axes, base, top, -1.2, f"{MM * ring.height:g}")
    _up(axes, 0.0, base, -1.2, f"{design.plate_count} × {t:g}")


def _bases(design: Design) -> list[tuple[float, float, float, float]]:
    """Corner, length and width of each base [mm]."""
    length, width = MM * design.plate.length, MM * design.plate.width
    if not design.separate_bases:
        return [(0.0, 0.0, length, width)]
    return [(MM * x - length / 2 + SLIT, MM * y - width / 2, length - 2 * SLIT, width) for x, y in design.teeth]


def _size(design: Design) -> tuple[float, float]:
    """Length and width of the whole sensor [mm]."""
    length, width = design.cell
    return MM * length * design.columns, MM * width * design.rows


def _once(label: str, place: float, number: int) -> str:
    """The label for the first of its kind, none for the others."""
    return label if math.isclose(place, 0.0, abs_tol=2 * SLIT) and number == 0 else "_"


def _across(axes: Axes, start: float, end: float, height: float, words: str) -> None:
    axes.annotate("", (start, height), (end, height), arrowprops=DIMENSION)
    axes.text((start + end) / 2, height + 0.15, words, ha="center", va="bottom", fontsize=9)


def _up(axes: Axes, low: float, high: float, x: float, words: str) -> None:
    axes.annotate("", (x, low), (x, high), arrowprops=DIMENSION)
    axes.text(x - 0.3, (low + high) / 2, words, ha="right", va="center", fontsize=9)
