"""Figures 4.7 to 4.17: the force ratio over the object's modulus, or over λ, by several theories or sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.evidence import Evidence
from palpate.instrument.models.parameter_sets import PHYSICAL
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.reproduce.curves import RING, STIFF_RING, Case, Curves
from palpate.procedures.reproduce.figures.lines import MODULI, Line
from palpate.procedures.reproduce.figures.picture import BEAM_COLOR, COLORS, THESIS, Picture, canvas, legend, save

Array = NDArray[np.float64]

# Styles of the lines. Later lines are finer, so that curves that agree are both visible.
STYLES, WIDTHS, SHADES = ("-", "--", "-.", ":"), (2.6, 1.4, 1.2, 1.2), (0.5, 1.0, 1.0, 1.0)
MARKERS, SIZES = "os^D", (6.0, 4.0, 5.0, 3.0)

LABELS = {"modulus": "Young modulus of the object (Pa)", "λ": "λ = E1 T2 / (E2 T1)"}
RANGES = {"modulus": (1e4, 2e8), "λ": (0.4, 1.2e4)}

APART = (
    "Of the thesis' 2D curves the six samples on the ring of 24 kPa are known, and no more; its text finds 2D and 3D in"
    " good agreement, where ours part above 0.2 MPa."
)
TWO = Line("2D", "single", "beam")
THREE = Line("3D", "single", "axisymmetric")
SINGLE = Line("single sensor", "single", "axisymmetric")
# The model and parameter set are those of the pair beside which it is drawn.
SINGLE_SOLID = Line("single sensor", "single", "solid")
COMMON = Line("common base", "common_base", "solid")
DIFFERENT = Line("different bases", "different_base", "solid")


@dataclass(frozen=True, slots=True)
class RatioFigure:
    """One of these figures.

    Attributes:
        number: number in the thesis, such as "Figure 4.8".
        lines: curves of the figure.
        over: quantity of the x axis, "modulus" or "λ".
        taken: what the text leaves open and how it is chosen here; may be empty.
    """

    number: str
    lines: tuple[Line, ...]
    over: str = "modulus"
    taken: str = ""


def _on_both_rings(*lines: Line) -> tuple[Line, ...]:
    return tuple(replace(line, ring=ring) for ring in (RING, STIFF_RING) for line in lines)


RATIO_FIGURES = (
    RatioFigure(
        "Figure 4.7", _on_both_rings(THREE, TWO), "λ",
        "The thickness in λ is not printed: it is the samples', 3 mm, for all. The ring is not stated: both are drawn."
        f" {APART}",
    ),
    RatioFigure("Figure 4.8", _on_both_rings(SINGLE)),
    RatioFigure("Figure 4.10", _on_both_rings(DIFFERENT)),
    RatioFigure("Figure 4.12", _on_both_rings(COMMON)),
    RatioFigure("Figure 4.13", (THREE, TWO), taken=APART),
    RatioFigure("Figure 4.14", tuple(replace(line, ring=STIFF_RING) for line in (THREE, TWO)), taken=APART),
    RatioFigure("Figure 4.15", _on_both_rings(THREE, TWO), taken=APART),
    RatioFigure("Figure 4.16", (COMMON, DIFFERENT), taken="The ring is not stated: it is that of Figure 4.17."),
    RatioFigure("Figure 4.17", (COMMON, SINGLE_SOLID)),
)  # fmt: skip


def cases(parameters: Sequence[str]) -> list[Case]:
    """Cases of the finite-element curves that these figures need."""
    lines = dict.fromkeys(line for figure in RATIO_FIGURES for line in figure.lines if line.model != "beam")
    return [line.case(name) for line in lines for name in parameters]


def draw(figure: RatioFigure, parameters: Sequence[str], curves: Curves, folder: Path) -> Picture:
    """Draw the figure and beside it the difference of our curves from the thesis' numbers. Raises RecordError."""
    drawing, (left, right) = canvas(figure.number, 2)
    for place, line in enumerate(figure.lines):
        drawn: dict[str, Any] = {"ls": STYLES[place], "alpha": SHADES[place]}
        marks: dict[str, Any] = {"marker": MARKERS[place], "ms": SIZES[place], "mew": 0.8, "mfc": "none"}
        moduli, ratios = line.thesis()
        at, printed = _over(figure, line, MODULI), _over(figure, line, moduli)
        if line.source:
            label = f"thesis, {line.label}: {line.source}"
            left.plot(printed, ratios, ls="", color=THESIS, label=label, **marks)
        for name in line.sets(tuple(parameters)):
            color = BEAM_COLOR if line.model == "beam" else COLORS[name]
            label = f"ours, {line.label}: {line.by(name)}, {line.evidence(name).value}"
            left.plot(at, line.ours(name, MODULI, curves), color=color, lw=WIDTHS[place], label=label, **drawn)
            difference = line.ours(name, moduli, curves) - ratios
            right.plot(printed, difference, color=color, lw=WIDTHS[place] / 2, **drawn, **marks)
    left.set(ylabel="force ratio: teeth over total", ylim=(0, 1.02))
    right.set(ylabel="force ratio: ours less the thesis'")
    right.axhline(0, color=THESIS, lw=0.6)
    for axes in (left, right):
        axes.set(xscale="log", xlim=RANGES[figure.over], xlabel=LABELS[figure.over])
        axes.grid(alpha=0.3)
    legend(drawing)
    return save(drawing, figure.number, _caption(figure, parameters), folder)


def _over(figure: RatioFigure, line: Line, moduli: Array) -> Array:
    """Values of moduli [Pa] on the figure's x axis."""
    if figure.over == "modulus":
        return moduli
    lambdas: Array = moduli * get_design(line.design).ring.height / (line.ring * PHYSICAL.sensed_thickness)
    return lambdas


def _caption(figure: RatioFigure, parameters: Sequence[str]) -> str:
    printed = [f"{line.label}: {line.source}" for line in figure.lines if line.source]
    missing = [line.label for line in figure.lines if not line.source]
    worth = {
        kind: [
            f"{line.label} by the {line.by(name)}"
            for line in figure.lines
            for name in line.sets(tuple(parameters))
            if line.evidence(name) is kind
        ]
        for kind in Evidence
    }
    parts = [f"Marks: the thesis' values, {'; '.join(printed)}"]
    if missing:
        parts.append(f"the thesis prints no values of {' and '.join(missing)}")
    parts += [f"ours, {kind.value}: {'; '.join(who)}" for kind, who in worth.items() if who]
    return f"{'. '.join(part[0].upper() + part[1:] for part in parts)}. {figure.taken}".rstrip()
