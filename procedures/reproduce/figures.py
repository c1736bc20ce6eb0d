"""The thesis' figures of chapters 4 and 5, and of the bridge in Appendix III, drawn with our data."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.calibration.bridge import Bridge
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.models import springs
from palpate.instrument.models.evidence import Evidence, of_experiment, of_model, ratio_by
from palpate.instrument.models.parameters import PHYSICAL
from palpate.instrument.models.response import response
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.thesis import COMMON_BASE_TABLES, SINGLE_TABLES, contents, read_table
from palpate.procedures.measurements.loads import SweepResult
from palpate.procedures.measurements.modulus import ModulusResult
from palpate.procedures.reproduce.chapter4 import OF_THEORY, beam_ratios, implied, sample_moduli
from palpate.procedures.reproduce.chapter5 import AT_3_N, BLIND_MODEL, RATIO, order_by_modulus
from palpate.procedures.reproduce.curves import RING, STIFF_RING, CurveCase, Curves
from palpate.procedures.reproduce.rows import Comparison
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


# --- The figures of chapter 4, and one of Table A2.7: the thesis' values as marks, our theories as curves

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


def model_pictures(parameters: Sequence[str], curves: Curves, folder: Path) -> Iterator[SavedPicture]:
    """Draw Figure 4.4 and Figures 4.7 to 4.17, one after the other. Raises RecordError."""
    yield _draw_area_ratios(folder)
    for figure in RATIO_FIGURES:
        yield _draw_theory_ratios(figure, parameters, curves, folder)


def model_cases(parameters: Sequence[str]) -> list[CurveCase]:
    """Cases of the finite-element curves that these figures need."""
    lines = dict.fromkeys(line for figure in RATIO_FIGURES for line in figure.lines if line.model != "beam")
    return [line.case(name) for line in lines for name in parameters]


def _draw_theory_ratios(figure: RatioFigure, parameters: Sequence[str], curves: Curves, folder: Path) -> SavedPicture:
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
    evidence = {
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
    parts += [f"ours, {kind.value}: {'; '.join(who)}" for kind, who in evidence.items() if who]
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
                evidence = column.evidence(series, comparison.table).value
                label = f"ours, {words}: {series.parameters} set, {evidence}"
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


# --- The figures of chapter 5: the orders of softness, and the experiments alone and beside the theories' curves

BY_MODULUS = "Figure 5.2"
# Figure of each design, and the table with its ratios.
BY_RATIO = {
    "single": ("Figure 5.3", "5.5"),
    "common_base": ("Figure 5.4", "5.6"),
    "different_base": ("Figure 5.5", "5.7"),
}
MOVED = "C3"  # colour of a sample that has another place in our order
# Text beside each sample, from hard to soft.
Order = Mapping[str, str]

# Squares, circles and diamonds, as the thesis has them.
ARRANGEMENTS = {
    "single": ("s", "single sensor"),
    "common_base": ("o", "common base"),
    "different_base": ("D", "different bases"),
}
RANGE = (1e4, 1e6)  # Pa; the end is not readable in the text, 1e5 or 1e6, but two samples lie above 1e5
ALONE = "Figure 5.6"
MEANS = "printed means over the load sets, Tables A2.9 to A2.20; of different bases the ratios under 3 N, Table 5.7"
ROUND = (
    " The benches lie off their curves where these are of a round sensor (model axisymmetric) and the benches of the"
    " square one."
)
BENCH = "ours, on simulated benches, with standard uncertainty"


@dataclass(frozen=True, slots=True)
class BenchMeasurements:
    """Measurements of the simulated benches.

    Attributes:
        swept: load sweep over all samples for each design.
        evidence: what agreement of the sweep's force ratios is worth, for each design.
        blind: the same sweep by a model that knows nothing of the experiments, for each design and parameter set.
        tested: compression test of each sample.
    """

    swept: Mapping[str, SweepResult]
    evidence: Mapping[str, Evidence]
    blind: Mapping[tuple[str, str], SweepResult]
    tested: Mapping[str, ModulusResult]


@dataclass(frozen=True, slots=True)
class ExperimentFigure:
    """Figure 5.7, 5.8 or 5.9: an arrangement with the curves of its theories."""

    number: str
    design: str
    tables: tuple[str, ...]  # of the experiments
    theories: tuple[TheoryCurve, ...]


WITH_THEORIES = (
    ExperimentFigure("Figure 5.7", "single", tuple(SINGLE_TABLES.values()), (THREE, TWO)),
    ExperimentFigure("Figure 5.8", "common_base", tuple(COMMON_BASE_TABLES.values()), (COMMON,)),
    ExperimentFigure("Figure 5.9", "different_base", ("5.7",), (DIFFERENT,)),
)


def bench_pictures(
    measured: BenchMeasurements, parameters: Sequence[str], curves: Curves, folder: Path
) -> Iterator[SavedPicture]:
    """Draw Figures 5.2 to 5.9, one after the other. Raises RecordError."""
    yield _draw_moduli(measured, folder)
    for design in BY_RATIO:
        yield _draw_bench_ratios(design, measured, folder)
    yield _draw_experiments(measured, folder)
    for figure in WITH_THEORIES:
        yield _draw_with_theories(figure, measured, parameters, curves, folder)


def bench_cases(parameters: Sequence[str]) -> list[CurveCase]:
    """Cases of the finite-element curves that these figures need."""
    lines = [line for figure in WITH_THEORIES for line in figure.theories if line.model != "beam"]
    return [line.case(name) for line in lines for name in parameters]


def _draw_moduli(measured: BenchMeasurements, folder: Path) -> SavedPicture:
    """Draw Figure 5.2. Raises RecordError."""
    printed = {name: SAMPLES[name].modulus for name in order_by_modulus()}
    tested = {name: found.compression.tangent for name, found in measured.tested.items()}
    moduli = printed | {name: tangent.value for name, tangent in tested.items()}
    beside = {name: f"u {tangent.u / 1e3:.1f}" for name, tangent in tested.items()}
    ours = {name: f"{moduli[name] / 1e3:.1f} kPa, {beside.get(name, 'as given')}" for name in _falling(moduli)}
    caption = (
        "Left: the thesis' order by the moduli of section 5.3. Right: ours. A simulated bench has compressed samples"
        f" {' and '.join(tested)}, whose moduli went in (input); the others are given by the thesis, samples 4 and 5"
        " with the digit that it has lost: 4823.30 and 2579.03 Pa are printed."
    )
    thesis = {name: f"{modulus / 1e3:.1f} kPa" for name, modulus in printed.items()}
    return _draw_orders(BY_MODULUS, thesis, ours, caption, folder)


def _draw_bench_ratios(design: str, measured: BenchMeasurements, folder: Path) -> SavedPicture:
    """Draw Figure 5.3, 5.4 or 5.5. Raises RecordError."""
    (number, source), evidence = BY_RATIO[design], measured.evidence[design]
    table = read_table(source)
    printed = dict(zip(table.rows, table.values("force_ratio").tolist(), strict=True))
    points = {point.sample: point for point in measured.swept[design].points if point.load_N == AT_3_N}
    order = _falling({name: point.force_ratio for name, point in points.items()})
    ours = {name: f"{points[name].force_ratio:.3f}, u {points[name].force_ratio_u:.3f}" for name in order}
    caption = (
        f"Left: the thesis' order, with the force ratios under {AT_3_N:g} N of Table {source}. Right: ours under that"
        f" load on a simulated bench, with standard uncertainty; {evidence.value}: {evidence.meaning}. Red: samples"
        " that change places."
    )
    thesis = {name: f"{printed[name]:.3f}" for name in get_design(design).thesis_softness_order}
    return _draw_orders(number, thesis, ours, caption, folder)


def _falling(values: Mapping[str, float]) -> list[str]:
    return sorted(values, key=lambda name: values[name], reverse=True)


def _draw_orders(number: str, thesis: Order, ours: Order, caption: str, folder: Path) -> SavedPicture:
    """Draw both orders side by side, with a line from each sample to itself."""
    drawing, (axes,) = canvas(number, simulated=True)
    places = {name: -float(place) for place, name in enumerate(ours)}
    for place, (name, words) in enumerate(thesis.items()):
        axes.text(-0.04, -place, f"sample {name}   {words}", ha="right", va="center", fontsize=10)
        if name in places:
            color = THESIS if places[name] == -place else MOVED
            axes.plot([0, 1], [-place, places[name]], "o-", color=color, ms=4, lw=1.2)
    for name, words in ours.items():
        axes.text(1.04, places[name], f"sample {name}   {words}", ha="left", va="center", fontsize=10)
    for x, words in ((0.0, "thesis"), (1.0, "ours")):
        axes.text(x, 0.75, words, ha="center", va="center", fontsize=10, fontweight="bold")
    axes.text(0.5, 0.4, "hard", ha="center", fontsize=9)
    axes.text(0.5, 0.4 - len(thesis), "soft", ha="center", fontsize=9)
    axes.set(xlim=(-1.2, 2.5), ylim=(0.2 - len(thesis), 1.1))
    axes.axis("off")
    return save(drawing, number, caption, folder)


def _draw_experiments(measured: BenchMeasurements, folder: Path) -> SavedPicture:
    """Draw Figure 5.6. Raises RecordError."""
    drawing, (axes,) = canvas(ALONE, simulated=True)
    for place, design in enumerate(ARRANGEMENTS):
        _experiment(axes, design, measured, f"C{place}")
    _finish(axes)
    legend(drawing)
    caption = (
        f"Hollow: the thesis' experiments ({MEANS}); whether it draws these or the ratios under 3 N is not said."
        f" Full: {BENCH}. {_evidence_sentence(measured)}."
    )
    return save(drawing, ALONE, caption, folder)


def _draw_with_theories(
    figure: ExperimentFigure, measured: BenchMeasurements, parameters: Sequence[str], curves: Curves, folder: Path
) -> SavedPicture:
    """Draw experiments and theories of the thesis and ours. Raises RecordError."""
    drawing, (axes,) = canvas(figure.number, simulated=True)
    moduli = np.geomspace(*RANGE, 40)
    models = []
    for line, style, marker in zip(figure.theories, ("-", "--"), ("x", "+"), strict=False):
        at, ratios = line.thesis()
        inside = at <= RANGE[1]
        axes.plot(
            at[inside], ratios[inside], marker, color=THESIS, ms=5, lw=0.8, label=f"thesis, {line.words}: {line.source}"
        )
        for name in line.sets(tuple(parameters)):
            color = BEAM_COLOR if line.model == "beam" else COLORS[name]
            by = line.model if line.model == "beam" else f"{line.model}, {name}"
            axes.plot(
                moduli, line.ours(name, moduli, curves), style, color=color, lw=1.3,
                label=f"ours, {line.words}: {by}, {_of_both(line, name, figure)}",
            )  # fmt: skip
            models.append(f"{line.words}, model {line.model}, {name} set: {line.evidence(name).value}")
    _experiment(axes, figure.design, measured, "C3")
    for (design, name), swept in measured.blind.items():
        if design == figure.design:
            evidence = of_experiment(RATIO, ratio_by(BLIND_MODEL, name), *figure.tables)
            _bench(axes, design, swept, COLORS[name], f"ours: bench by {name} set, {evidence.value}")
    _finish(axes)
    legend(drawing, columns=1)
    caption = (
        f"Hollow: the thesis' experiments ({MEANS}). Crosses: its theories"
        f" ({'; '.join(f'{line.words}: {line.source}' for line in figure.theories)}). Full: {BENCH}."
        f" {_evidence_sentence(measured, figure.design)}. In the curves' colours: the same benches by finite"
        f" elements of that set (model {BLIND_MODEL}) in the place of the means. Curves: ours on the ring of 24 kPa;"
        f" none is fitted to these"
        f" experiments; beside the crosses they are: {'; '.join(models)}."
        + (ROUND if any(line.model == "axisymmetric" for line in figure.theories) else "")
    )
    return save(drawing, figure.number, caption, folder)


def _of_both(line: TheoryCurve, parameters: str, figure: ExperimentFigure) -> str:
    """What a curve is worth beside the thesis' theories, its crosses, and beside the experiments."""
    crosses, experiments = line.evidence(parameters), line.evidence(parameters, *figure.tables)
    return crosses.value if crosses is experiments else f"{crosses.value} (beside experiments: {experiments.value})"


def _experiment(axes: Axes, design: str, measured: BenchMeasurements, color: str) -> None:
    """Draw the thesis' experiments and ours."""
    marker, words = ARRANGEMENTS[design]
    thesis = get_design(design).thesis_force_ratio
    moduli = [SAMPLES[name].modulus for name in thesis]
    label = f"thesis, {words}: experiment"
    axes.plot(moduli, list(thesis.values()), marker, color=THESIS, ms=7, mfc="none", label=label)
    label = f"ours, {words}: bench, {measured.evidence[design].value}"
    _bench(axes, design, measured.swept[design], color, label)


def _bench(axes: Axes, design: str, swept: SweepResult, color: str, label: str) -> None:
    """Draw the mean ratios of a sweep with their standard uncertainty."""
    means = [
        (SAMPLES[mean.sample].modulus, mean.force_ratio, mean.force_ratio_u)
        for mean in swept.samples
        if mean.force_ratio is not None and mean.force_ratio_u is not None
    ]
    if means:
        moduli, ratios, u = zip(*means, strict=True)
        marker, _ = ARRANGEMENTS[design]
        axes.errorbar(moduli, ratios, u, fmt=marker, color=color, ms=3.5, capsize=2, lw=0.8, label=label)


def _evidence_sentence(measured: BenchMeasurements, *designs: str) -> str:
    """Text on what agreement of the benches' ratios is worth, for all or some designs."""
    kinds = dict.fromkeys(measured.evidence[design] for design in designs or measured.evidence)
    return f"They are {'; '.join(f'{kind.value}: {kind.meaning}' for kind in kinds)}"


def _finish(axes: Axes) -> None:
    axes.set(
        xscale="log", xlim=RANGE, ylim=(0, None), xlabel="Young modulus of the object (Pa)",
        ylabel="force ratio: teeth over total",
    )  # fmt: skip
    axes.grid(alpha=0.3)


# --- Figure A3.5: what the bridge of the strain indicator gives. The thesis prints its equations and no numbers

BRIDGE = "Figure A3.5"


def draw_bridge(folder: Path) -> SavedPicture:
    """Draw the output over one arm and over the strain of one gage or four. Raises RecordError."""
    figure, (arm, gages) = canvas(BRIDGE, 2)
    ratios, strains, factor = np.linspace(0.02, 3, 150), np.linspace(-2e-3, 2e-3, 81), THESIS_LOAD_CELL.gage_factor
    arm.plot(ratios, [Bridge(ratio, 1, 1, 1).output for ratio in ratios], color="C0", label="R2 = R3 = R4")
    arm.plot([Bridge(1, 1, 1, 1).balancing_r1], [0], "o", color="C3", label="balance, R1 R3 = R2 R4")
    arm.set(xlabel="R1 / R2", ylabel="e / E")
    one = [1e3 * Bridge.of_gages(factor, strain, 0, 0, 0).output for strain in strains]
    four = [1e3 * Bridge.of_gages(factor, strain, -strain, strain, -strain).output for strain in strains]
    gages.plot(1e6 * strains, one, color="C1", label="one gage")
    gages.plot(1e6 * strains, four, color="C2", label="four gages, as in 5.2")
    gages.set(xlabel="strain [µm/m]", ylabel="e / E [mV/V]")
    legend(figure)
    caption = (
        "Computed by equations A3.1 to A3.3, whose indices are not readable; the thesis prints no numbers, so that"
        f" nothing is compared. Right: at the gage factor of {factor:g} from 5.2. The output of one gage is at most"
        f" {100 * (1 - 4 * one[-1] / four[-1]):.2f} % off a straight line when stretched; of four it is straight."
    )
    return save(figure, BRIDGE, caption, folder)
