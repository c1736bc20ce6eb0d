"""Figures 4.1a, 4.9 and 4.11a: plan and section of the three sensors, to scale, from their designs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.models.parameter_sets import PHYSICAL
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.reproduce.figures.picture import Picture, canvas, legend, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SENSORS = {"Figure 4.1a": "single", "Figure 4.9": "different_base", "Figure 4.11a": "common_base"}
MM = 1e3
BODIES = {"object": "#f2cfc0", "compliant ring": "0.35", "rigid tooth": "#e8e2c8", "base plates": "#bcd7ea"}
SLIT = 0.04  # mm on either side of the cut between bases side by side
DIMENSION = {"arrowstyle": "<->", "lw": 0.8, "shrinkA": 0, "shrinkB": 0}


def draw(number: str, folder: Path) -> Picture:
    """Draw plan and section of one of SENSORS. Raises RecordError."""
    design = get_design(SENSORS[number])
    drawing, (plan, section) = canvas(number, 2)
    _draw_plan(plan, design)
    _draw_section(section, design)
    length, width = _size(design)
    for axes in (plan, section):
        axes.set(aspect="equal", xlim=(-3.5, length + 0.5), ylim=(-2.0, width + 2.0))
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
    from matplotlib.patches import Circle

    for x, y, length, width in _bases(design):
        _block(axes, "base plates", x, y, length, width)
    circles = (
        ("compliant ring", design.ring.outer_radius),
        ("base plates", design.ring.inner_radius),
        ("rigid tooth", design.tooth.radius),
    )
    for x, y in design.teeth:
        for body, radius in circles:
            axes.add_patch(Circle((MM * x, MM * y), MM * radius, fc=BODIES[body], ec="k", lw=0.6))
    length, width = _size(design)
    _across(axes, 0.0, length, -1.4, f"{length:g}")
    _up(axes, 0.0, width, -1.2, f"{width:g}")
    if len(design.teeth) > 1:
        first, second = (MM * x for x, _ in design.teeth[:2])
        _across(axes, first, second, width + 0.5, f"{second - first:g}")


def _draw_section(axes: Axes, design: Design) -> None:
    ring, tooth = design.ring, design.tooth
    radius, inner, outer = MM * tooth.radius, MM * ring.inner_radius, MM * ring.outer_radius
    plate, sensed = MM * design.plate.thickness, MM * PHYSICAL.sensed_thickness
    base = design.plate_count * plate
    top = base + MM * tooth.height
    for x, _, length, _ in _bases(design):
        for number in range(design.plate_count):
            _block(axes, "base plates", x, number * plate, length, plate)
        _film(axes, x, x + length, plate)
    for x in (MM * place for place, _ in design.teeth):
        for start in (x - outer, x + inner):
            _block(axes, "compliant ring", start, base, outer - inner, MM * ring.height)
        _block(axes, "rigid tooth", x - radius, base, 2 * radius, MM * tooth.height)
        _film(axes, x - radius, x + radius, base)
    _block(axes, "object", 0.0, top, _size(design)[0], sensed)
    first = MM * design.teeth[0][0]
    _across(axes, first - radius, first + radius, top + 0.3 * sensed, f"⌀ {2 * radius:g}")
    _across(axes, first - outer, first + outer, -1.2, f"⌀ {2 * outer:g}, inside {2 * inner:g}")
    _up(axes, base, top, -1.2, f"{MM * tooth.height:g}")
    _up(axes, 0.0, base, -1.2, f"{design.plate_count} × {plate:g}")


def _block(axes: Axes, body: str, x: float, z: float, length: float, height: float) -> None:
    """Draw a rectangle with its lower left corner at x, z [mm]."""
    from matplotlib.patches import Rectangle

    axes.add_patch(Rectangle((x, z), length, height, fc=BODIES[body], ec="k", lw=0.6, label=body))


def _film(axes: Axes, start: float, end: float, height: float) -> None:
    axes.plot([start, end], [height, height], color="C3", lw=2.5, solid_capstyle="butt", label="films")


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


def _across(axes: Axes, start: float, end: float, height: float, words: str) -> None:
    axes.annotate("", (start, height), (end, height), arrowprops=DIMENSION)
    axes.text((start + end) / 2, height + 0.15, words, ha="center", va="bottom", fontsize=9)


def _up(axes: Axes, low: float, high: float, x: float, words: str) -> None:
    axes.annotate("", (x, low), (x, high), arrowprops=DIMENSION)
    axes.text(x - 0.3, (low + high) / 2, words, ha="right", va="center", fontsize=9)
