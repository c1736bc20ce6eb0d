"""Figures of chapter 4 of the thesis, redrawn. What each shows is inferred, from the tables and sections around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from instrument.thesis import read_table
from procedures.reproduce.comparison import Comparison
from procedures.reproduce.curves import BASE, RING, STIFF_RING, TOOTH, Case, Curves
from procedures.reproduce.theory import OF_THEORY, beam_ratios, implied, sample_moduli, table_ratio
from procedures.run import storing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MODULI = np.geomspace(14.9e3, 140e6, 100)  # Table A2.1 without its last row, 140 GPa
COLORS = {"physical": "C0", "identified": "C1"}
INFERRED = (
    "Captions are inferred: the thesis' text is not at hand, only its tables and the sections that they stand in."
)


@dataclass(frozen=True, slots=True)
class Subject:
    """What a curve is of: a design by a model, and the table that has it."""

    label: str
    design: str
    model: str
    table: str | None

    def case(self, parameters: str, ring: float) -> Case:
        return Case(self.design, self.model, parameters, ring)

    def ours(self, parameters: str, ring: float, curves: Curves) -> Array:
        """Force ratio at MODULI."""
        if self.model == "beam":
            return _beam(ring)
        return curves.of(self.case(parameters, ring)).force_ratio(MODULI)

    def thesis(self) -> tuple[Array, Array]:
        """Moduli [Pa] and force ratios of the thesis, ring 24 kPa."""
        if self.table is None:
            return sample_moduli(), implied("single_vs_2D")[OF_THEORY]
        moduli = read_table(self.table).keys()
        inside = moduli <= MODULI[-1]
        return moduli[inside], table_ratio(self.table, moduli[inside])


@cache
def _beam(ring: float) -> Array:
    return beam_ratios(MODULI, ring)


SINGLE = Subject("single sensor", "single", "axisymmetric", "A2.1")
# Beside the common base, with the same set of parameters.
SINGLE_SOLID = Subject("single sensor", "single", "solid", "A2.1")
BEAM = Subject("two dimensions", "single", "beam", None)
ROUND = Subject("three dimensions", "single", "axisymmetric", "A2.1")
COMMON = Subject("common base", "common_base", "solid", "A2.3")
DIFFERENT = Subject("different bases", "different_base", "solid", "A2.5")


@dataclass(frozen=True, slots=True)
class ThesisFigure:
    """One figure.

    Attributes:
        number: in the thesis.
        subjects: one, drawn on all rings with its voltages, or two that are compared on one ring.
        rings: Young moduli [Pa].
        content: what it shows.
        ground: why it is taken to show that.
    """

    number: str
    subjects: tuple[Subject, ...]
    rings: tuple[float, ...]
    content: str
    ground: str


@dataclass(frozen=True, slots=True)
class Picture:
    """A drawing on disk; `ground` is empty where nothing about it is inferred."""

    name: str
    content: str
    ground: str
    file: Path


_RINGS = "one of six for the three comparisons of 4.5 on the two rings"
_VALUES = "force ratio and film voltages"
FIGURES = (
    ThesisFigure("4.4", (SINGLE,), (RING, STIFF_RING), f"single sensor: {_VALUES}", "4.2, Table 4.1"),
    ThesisFigure("4.7", (DIFFERENT,), (RING, STIFF_RING), f"different bases: {_VALUES}", "4.3, Table 4.3; uncertain"),
    ThesisFigure("4.8", (COMMON,), (RING, STIFF_RING), f"common base: {_VALUES}", "4.4, Table 4.5; uncertain"),
    *(
        ThesisFigure(number, subjects, (ring,), f"{content}, ring {ring / 1e3:.0f} kPa", f"{section}; {_RINGS}")
        for number, subjects, ring, content, section in (
            ("4.12", (BEAM, ROUND), RING, "two against three dimensions", "4.5.1"),
            ("4.13", (BEAM, ROUND), STIFF_RING, "two against three dimensions", "4.5.1"),
            ("4.14", (DIFFERENT, COMMON), RING, "different bases against a common one", "4.5.2"),
            ("4.15", (DIFFERENT, COMMON), STIFF_RING, "different bases against a common one", "4.5.2"),
            ("4.16", (COMMON, SINGLE_SOLID), RING, "common base against single sensor", "4.5.3"),
            ("4.17", (COMMON, SINGLE_SOLID), STIFF_RING, "common base against single sensor", "4.5.3"),
        )
    ),
)


def cases(parameters: Sequence[str]) -> list[Case]:
    """The curves that the figures need."""
    return [
        subject.case(name, ring)
        for figure in FIGURES
        for subject in figure.subjects
        for ring in figure.rings
        for name in parameters
        if subject.model != "beam"
    ]


def draw(figure: ThesisFigure, parameters: Sequence[str], curves: Curves, folder: Path) -> Picture:
    """Draw a figure as PNG.

    Raises:
        RecordError: it cannot be written.
    """
    canvas, (left, right) = _canvas(f"Figure {figure.number} (content inferred): {figure.content}")
    if len(figure.subjects) == 1:
        _draw_ratios(left, figure.subjects[0], figure.rings, parameters, curves)
        _draw_voltages(right, figure.subjects[0], parameters, curves)
    else:
        _draw_compared(left, figure.subjects, figure.rings[0], parameters, curves)
        _draw_difference(right, figure.subjects, figure.rings[0], parameters, curves)
    for axes in (left, right):
        axes.set(xscale="log", xlabel="Young modulus of the object (Pa)")
    file = _save(canvas, folder / f"figure_{figure.number.replace('.', '_')}.png")
    return Picture(f"Figure {figure.number}", figure.content, figure.ground, file)


def draw_position(comparison: Comparison, folder: Path) -> Picture:
    """Table A2.7 as PNG: forces of both teeth and their ratio along the common base."""
    content = "common base under a load of 1 N along its length"
    canvas, (left, right) = _canvas(f"Table A2.7: {content}")
    x = comparison.table.keys()
    by_name = {column.quantity: column for column in comparison.columns}
    for axes, shown in ((left, ("force_pvdf3_N", "force_pvdf1_N")), (right, ("force_ratio",))):
        for name, marker, style in zip(shown, "os", ("-", "--"), strict=False):
            tooth = {"force_pvdf3_N": "left tooth", "force_pvdf1_N": "right tooth"}.get(name, "both teeth")
            column = by_name[name]
            axes.plot(x, column.thesis, marker, color="k", ms=4, mfc="none", label=f"thesis, {tooth}")
            for series in column.ours:
                axes.plot(
                    x, series.values, style, color=COLORS[series.parameters], label=f"{series.parameters}, {tooth}"
                )
        axes.axhline(0, color="k", lw=0.6)
        axes.set(xlabel="place of the load (mm, inferred)")
        axes.legend(fontsize=7, ncols=2, loc="upper center")
        axes.set_ylim(None, 1.35)
    left.set(ylabel="force on a tooth (N)")
    right.set(ylabel="force on both teeth over total force")
    return Picture("Table A2.7", content, "", _save(canvas, folder / "table_A2_7.png"))


def _draw_ratios(
    axes: Axes, subject: Subject, rings: Sequence[float], parameters: Sequence[str], curves: Curves
) -> None:
    axes.plot(*subject.thesis(), "ko", ms=4, mfc="none", label=f"thesis, Table {subject.table}, ring 24 kPa")
    for name in parameters:
        for ring, style in zip(rings, ("-", ":"), strict=False):
            label = f"{name} set, ring {ring / 1e3:.0f} kPa"
            axes.plot(MODULI, subject.ours(name, ring, curves), style, color=COLORS[name], label=label)
    axes.set(ylabel="force ratio: teeth over total", ylim=(0, 1.02))
    axes.legend(fontsize=8, loc="lower right")


def _draw_voltages(axes: Axes, subject: Subject, parameters: Sequence[str], curves: Curves) -> None:
    table = read_table(str(subject.table))
    inside = table.keys() <= MODULI[-1]
    tooth = "voltage_pvdf2_V" if subject.design == "single" else "voltage_pvdf1_V"
    shown = [(TOOTH, tooth, "o", "-")] + ([(BASE, "voltage_pvdf1_V", "s", "--")] if subject.design == "single" else [])
    for film, column, marker, style in shown:
        thesis = abs(table.values(column)[inside])
        axes.plot(table.keys()[inside], thesis, marker, color="k", ms=4, mfc="none", label=f"thesis, {film} film")
        for name in parameters:
            voltage = curves.of(subject.case(name, RING)).voltage(film, MODULI)
            axes.plot(MODULI, voltage, style, color=COLORS[name], label=f"{name} set, {film} film")
    axes.set(ylabel="open-circuit voltage of a film under 1 N (V)", yscale="log", ylim=(1e-5, 10))
    axes.legend(fontsize=7, loc="center right", ncols=2)
    axes.set_title("ring 24 kPa; the thesis' voltages are a slip of units below ours", fontsize=9)


def _draw_compared(
    axes: Axes, subjects: Sequence[Subject], ring: float, parameters: Sequence[str], curves: Curves
) -> None:
    for subject, style, marker in zip(subjects, ("-", "--"), "os", strict=True):
        if ring == RING:
            origin = f"Table {subject.table}" if subject.table else "rebuilt from Table 5.8"
            axes.plot(
                *subject.thesis(), marker, color="k", ms=4, mfc="none", label=f"thesis, {subject.label}, {origin}"
            )
        for name in parameters if subject.model != "beam" else ("physical",):
            color = "C2" if subject.model == "beam" else COLORS[name]
            label = f"{subject.label}, {'beam' if subject.model == 'beam' else name + ' set'}"
            axes.plot(MODULI, subject.ours(name, ring, curves), style, color=color, label=label)
    axes.set(ylabel="force ratio: teeth over total", ylim=(0, 1.02))
    axes.legend(fontsize=8, loc="lower right")
    if ring != RING:
        axes.set_title("the thesis' tables for this ring are not transcribed", fontsize=9)


def _draw_difference(
    axes: Axes, subjects: Sequence[Subject], ring: float, parameters: Sequence[str], curves: Curves
) -> None:
    first, second = subjects
    if ring == RING:
        moduli, ratios = first.thesis()
        other = table_ratio(str(second.table), moduli)
        axes.plot(moduli, ratios - other, "ko", ms=4, mfc="none", label="thesis")
    for name in parameters:
        difference = first.ours(name, ring, curves) - second.ours(name, ring, curves)
        axes.plot(MODULI, difference, color=COLORS[name], label=f"{name} set")
    axes.axhline(0, color="k", lw=0.6)
    axes.set(ylabel=f"force ratio: {first.label} less {second.label}")
    axes.legend(fontsize=8)


def _canvas(title: str) -> tuple[Figure, tuple[Axes, Axes]]:
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(11, 4.4), layout="constrained")
    canvas.suptitle(title)
    left, right = canvas.add_subplot(1, 2, 1), canvas.add_subplot(1, 2, 2)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return canvas, (left, right)


def _save(canvas: Figure, path: Path) -> Path:
    with storing(path):
        canvas.savefig(path, dpi=120, metadata={"Software": None})
    return path
