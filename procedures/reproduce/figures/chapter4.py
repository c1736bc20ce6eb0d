"""The figures of chapter 4, and one of Table A2.7: the thesis' values as marks, our theories as curves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models import springs
from palpate.instrument.models.evidence import Evidence, of_model, ratio_by
from palpate.instrument.models.parameters import PHYSICAL
from palpate.instrument.models.response import response
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.thesis import read_table
from palpate.procedures.reproduce.chapter4.theory import OF_THEORY, beam_ratios, implied, sample_moduli
from palpate.procedures.reproduce.curves import RING, STIFF_RING, CurveCase, Curves
from palpate.procedures.reproduce.figures.picture import BEAM_COLOR, COLORS, THESIS, SavedPicture, canvas, legend, save
from palpate.procedures.reproduce.judging.rows import Comparison

Array = NDArray[np.float64]

AREA, POSITION = "Figure 4.4", "Table A2.7"
AREA_RATIOS = (1.0, 2.0, 5.0, 10.0, 20.0)  # the text praises 1 to 10, and finds steeper curves beyond
LAMBDAS = np.geomspace(1e-2, 1e4, 37)
TEETH = {"force_pvdf3_N": ("left tooth", "o", "-"), "force_pvdf1_N": ("right tooth", "s", "--")}
BOTH_TEETH = {"force_ratio": ("both teeth", "D", "-")}
MODULI = np.geomspace(14.9e3, 140e6, 60)  # Table A2.1 without its last row, 140 GPa
BEAM_SET = "physical"  # the only set of the beam
# Tables of each design's force ratio at all moduli, by ring.
TABLES = {
    "single": {RING: "A2.1", STIFF_RING: "A2.2"},
    "common_base": {RING: "A2.3", STIFF_RING: "A2.4"},
    "different_base": {RING: "A2.5", STIFF_RING: "A2.6"},
}


@dataclass(frozen=True, slots=True)
class TheoryCurve:
    """A curve of a figure: the sensor, also in words, our model, and the modulus of the ring [Pa]."""

    words: str
    design: str
    model: str
    ring: float = RING

    @property
    def label(self) -> str:
        return f"{self.words}, ring {self.ring / 1e3:.0f} kPa"

    @property
    def source(self) -> str:
        """Table in which the thesis prints the values; empty: none."""
        if self.model != "beam":
            return f"Table {TABLES[self.design][self.ring]}"
        return "rebuilt from Table 5.8" if self.ring == RING else ""

    def sets(self, parameters: tuple[str, ...]) -> tuple[str, ...]:
        """The parameter sets among these that the model has."""
        return parameters if self.model != "beam" else tuple(name for name in parameters if name == BEAM_SET)

    def case(self, parameters: str) -> CurveCase:
        return CurveCase(self.design, self.model, parameters, self.ring)

    def ours(self, parameters: str, moduli: Array, curves: Curves) -> Array:
        """Our force ratios at moduli of the object [Pa]."""
        if self.model == "beam":
            return np.array(_beam(tuple(moduli.tolist()), self.ring))
        return curves.of(self.case(parameters)).force_ratio(moduli)

    def thesis(self) -> tuple[Array, Array]:
        """The thesis' moduli [Pa], without 140 GPa, and force ratios; empty where it prints none."""
        if not self.source:
            return np.array([]), np.array([])
        if self.model == "beam":
            order = np.argsort(sample_moduli())
            return sample_moduli()[order], implied("single_vs_2D")[OF_THEORY][order]
        table = read_table(TABLES[self.design][self.ring])
        ratio = table.values("force_ratio" if "force_ratio" in table.columns else "force_rigid_N")
        inside = table.keys() <= MODULI[-1]
        return table.keys()[inside], abs(ratio[inside])

    def evidence(self, parameters: str, *tables: str) -> Evidence:
        """Evidence of our curve by a parameter set, beside tables of the thesis; by default those of `thesis`."""
        own = () if not self.source else ("5.8",) if self.model == "beam" else (TABLES[self.design][self.ring],)
        return of_model("force_ratio", ratio_by(self.model, parameters), *(tables or own))

    def by(self, parameters: str) -> str:
        """Label of our curve."""
        return "beam" if self.model == "beam" else f"{parameters} set"


@cache
def _beam(moduli: tuple[float, ...], ring: float) -> tuple[float, ...]:
    return tuple(beam_ratios(np.array(moduli), ring).tolist())


# Styles of the lines. Later lines are finer, so that curves that agree are both visible.
STYLES, WIDTHS, SHADES = ("-", "--", "-.", ":"), (2.6, 1.4, 1.2, 1.2), (0.5, 1.0, 1.0, 1.0)
MARKERS, SIZES = "os^D", (6.0, 4.0, 5.0, 3.0)

LABELS = {"modulus": "Young modulus of the object (Pa)", "λ": "λ = E1 T2 / (E2 T1)"}
RANGES = {"modulus": (1e4, 2e8), "λ": (0.4, 1.2e4)}

APART = (
    "Of the thesis' 2D curves the six samples on the ring of 24 kPa are known, and no more; its text finds 2D and 3D in"
    " good agreement, where ours part above 0.2 MPa."
)
TWO = TheoryCurve("2D", "single", "beam")
THREE = TheoryCurve("3D", "single", "axisymmetric")
SINGLE = TheoryCurve("single sensor", "single", "axisymmetric")
# The model and parameter set are those of the pair beside which it is drawn.
SINGLE_SOLID = TheoryCurve("single sensor", "single", "solid")
COMMON = TheoryCurve("common base", "common_base", "solid")
DIFFERENT = TheoryCurve("different bases", "different_base", "solid")


@dataclass(frozen=True, slots=True)
class RatioFigure:
    """One of Figures 4.7 to 4.17: the force ratio over the object's modulus, or over λ.

    Attributes:
        number: number in the thesis, such as "Figure 4.8".
        lines: curves of the figure.
        over: quantity of the x axis, "modulus" or "λ".
        taken: what the text leaves open and how it is chosen here; may be empty.
    """

    number: str
    lines: tuple[TheoryCurve, ...]
    over: str = "modulus"
    taken: str = ""


def _on_both_rings(*lines: TheoryCurve) -> tuple[TheoryCurve, ...]:
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


def pictures(parameters: Sequence[str], curves: Curves, folder: Path) -> Iterator[SavedPicture]:
    """Draw Figure 4.4 and Figures 4.7 to 4.17, one after the other. Raises RecordError."""
    yield _draw_area_ratios(folder)
    for figure in RATIO_FIGURES:
        yield _draw_ratios(figure, parameters, curves, folder)


def cases(parameters: Sequence[str]) -> list[CurveCase]:
    """Cases of the finite-element curves that these figures need."""
    lines = dict.fromkeys(line for figure in RATIO_FIGURES for line in figure.lines if line.model != "beam")
    return [line.case(name) for line in lines for name in parameters]


def _draw_ratios(figure: RatioFigure, parameters: Sequence[str], curves: Curves, folder: Path) -> SavedPicture:
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


def _over(figure: RatioFigure, line: TheoryCurve, moduli: Array) -> Array:
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


def _draw_area_ratios(folder: Path) -> SavedPicture:
    """Draw columns and beam for several area ratios and the sensor's own. Raises RecordError."""
    drawing, (axes,) = canvas(AREA)
    sensor = get_design("single")
    own = sensor.ring.area / sensor.tooth.area
    thickness = PHYSICAL.sensed_thickness
    for place, ratio in enumerate(sorted((*AREA_RATIOS, own))):
        design = with_area_ratio(sensor, ratio)
        moduli = LAMBDAS * design.ring.material.modulus * thickness / design.ring.height
        columns = springs.ratio_of_modulus(design, moduli, thickness)
        beam = [response(design, PHYSICAL.load(float(modulus)), "beam").force_ratio for modulus in moduli]
        label = f"A = {ratio:.4g}{', the sensor' if ratio == own else ''}"
        axes.plot(LAMBDAS, columns, color=f"C{place}", lw=1.4, label=f"{label}: columns")
        axes.plot(LAMBDAS, beam, "--", color=f"C{place}", lw=1.0, label=f"{label}: beam")
    axes.set(
        xscale="log", ylim=(0, 1.02), xlabel="λ = E1 T2 / (E2 T1)", ylabel="force ratio: tooth over total"
    )  # fmt: skip
    axes.grid(alpha=0.3)
    legend(drawing, columns=3)
    caption = (
        "The thesis prints no numbers of it, and its area ratios are not readable: nothing can be compared."
        " Columns: R = a (1 + λ) / (1 + a λ) with the tooth's share a = 1 / (1 + A) of the area. Beam: on a ring whose"
        f" outer radius gives the area ratio A of ring to tooth; the sensor's own is {own:.2f}, printed 11.60."
        f" The object is {1e3 * thickness:g} mm thick."
    )
    return save(drawing, AREA, caption, folder)


def with_area_ratio(sensor: Design, ratio: float) -> Design:
    """The sensor with another area of the ring over that of the tooth."""
    outer = math.sqrt(sensor.ring.inner_radius**2 + ratio * sensor.tooth.radius**2)
    ring = replace(sensor.ring, outer_radius=outer)
    # A ring that is wider than the plates gets wider plates.
    half = max(outer, sensor.plate.length / 2)
    plate = replace(sensor.plate, length=2 * half, width=2 * half)
    return replace(sensor, ring=ring, plate=plate, teeth=((half, half),))


def draw_position(comparison: Comparison, folder: Path) -> SavedPicture:
    """Draw Table A2.7, the teeth on the left and their sum on the right. Raises RecordError."""
    drawing, (left, right) = canvas(POSITION, 2)
    x = comparison.table.keys()
    for axes, shown in ((left, TEETH), (right, BOTH_TEETH)):
        for column in comparison.columns:
            if column.quantity not in shown:
                continue
            words, marker, style = shown[column.quantity]
            axes.plot(x, column.thesis, marker, color=THESIS, ms=4, mfc="none", label=f"thesis, {words}")
            for series in column.ours:
                worth = column.evidence(series, comparison.table).value
                label = f"ours, {words}: {series.parameters} set, {worth}"
                axes.plot(x, series.values, style, color=COLORS[series.parameters], lw=1.3, label=label)
        axes.axhline(0, color=THESIS, lw=0.6)
        axes.grid(alpha=0.3)
        axes.set(xlabel="place of the load (mm, inferred)")
    left.set(ylabel="force on a tooth (N)")
    right.set(ylabel="force on both teeth over total force")
    legend(drawing, columns=3)
    caption = (
        "Marks: the thesis' table. Curves: ours by model solid under a force of 1 N in one point; the legend says which"
        " set was fitted to this table and which predicts it."
    )
    return save(drawing, POSITION, caption, folder)
