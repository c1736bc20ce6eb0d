"""The figures of chapter 5: the orders of softness, and the experiments alone and beside the theories' curves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.instrument.models.evidence import Evidence, of_experiment, ratio_by
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.thesis import COMMON_BASE_TABLES, SINGLE_TABLES, read_table
from palpate.procedures.measurements.loads.result import SweepResult
from palpate.procedures.measurements.modulus.result import ModulusResult
from palpate.procedures.reproduce.chapter5.blind import MODEL
from palpate.procedures.reproduce.chapter5.columns import RATIO
from palpate.procedures.reproduce.chapter5.experiments import AT_3_N, order_by_modulus
from palpate.procedures.reproduce.curves import CurveCase, Curves
from palpate.procedures.reproduce.figures.chapter4 import COMMON, DIFFERENT, THREE, TWO, TheoryCurve
from palpate.procedures.reproduce.figures.picture import BEAM_COLOR, COLORS, THESIS, SavedPicture, canvas, legend, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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


def pictures(
    measured: BenchMeasurements, parameters: Sequence[str], curves: Curves, folder: Path
) -> Iterator[SavedPicture]:
    """Draw Figures 5.2 to 5.9, one after the other. Raises RecordError."""
    yield _draw_moduli(measured, folder)
    for design in BY_RATIO:
        yield _draw_ratios(design, measured, folder)
    yield _draw_experiments(measured, folder)
    for figure in WITH_THEORIES:
        yield _draw_with_theories(figure, measured, parameters, curves, folder)


def cases(parameters: Sequence[str]) -> list[CurveCase]:
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


def _draw_ratios(design: str, measured: BenchMeasurements, folder: Path) -> SavedPicture:
    """Draw Figure 5.3, 5.4 or 5.5. Raises RecordError."""
    (number, source), worth = BY_RATIO[design], measured.evidence[design]
    table = read_table(source)
    printed = dict(zip(table.rows, table.values("force_ratio").tolist(), strict=True))
    points = {point.sample: point for point in measured.swept[design].points if point.load_N == AT_3_N}
    order = _falling({name: point.force_ratio for name, point in points.items()})
    ours = {name: f"{points[name].force_ratio:.3f}, u {points[name].force_ratio_u:.3f}" for name in order}
    caption = (
        f"Left: the thesis' order, with the force ratios under {AT_3_N:g} N of Table {source}. Right: ours under that"
        f" load on a simulated bench, with standard uncertainty; {worth.value}: {worth.meaning}. Red: samples that"
        " change places."
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
        f" Full: {BENCH}. {_worth(measured)}."
    )
    return save(drawing, ALONE, caption, folder)


def _draw_with_theories(
    figure: ExperimentFigure, measured: BenchMeasurements, parameters: Sequence[str], curves: Curves, folder: Path
) -> SavedPicture:
    """Draw experiments and theories of the thesis and ours. Raises RecordError."""
    drawing, (axes,) = canvas(figure.number, simulated=True)
    moduli = np.geomspace(*RANGE, 40)
    said = []
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
            said.append(f"{line.words}, model {line.model}, {name} set: {line.evidence(name).value}")
    _experiment(axes, figure.design, measured, "C3")
    for (design, name), swept in measured.blind.items():
        if design == figure.design:
            worth = of_experiment(RATIO, ratio_by(MODEL, name), *figure.tables)
            _bench(axes, design, swept, COLORS[name], f"ours: bench by {name} set, {worth.value}")
    _finish(axes)
    legend(drawing, columns=1)
    caption = (
        f"Hollow: the thesis' experiments ({MEANS}). Crosses: its theories"
        f" ({'; '.join(f'{line.words}: {line.source}' for line in figure.theories)}). Full: {BENCH}."
        f" {_worth(measured, figure.design)}. In the curves' colours: the same benches by finite elements of that set"
        f" (model {MODEL}) in the place of the means. Curves: ours on the ring of 24 kPa; none is fitted to these"
        f" experiments; beside the crosses they are: {'; '.join(said)}."
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


def _worth(measured: BenchMeasurements, *designs: str) -> str:
    """Text on what agreement of the benches' ratios is worth, for all or some designs."""
    kinds = dict.fromkeys(measured.evidence[design] for design in designs or measured.evidence)
    return f"They are {'; '.join(f'{kind.value}: {kind.meaning}' for kind in kinds)}"


def _finish(axes: Axes) -> None:
    axes.set(
        xscale="log", xlim=RANGE, ylim=(0, None), xlabel="Young modulus of the object (Pa)",
        ylabel="force ratio: teeth over total",
    )  # fmt: skip
    axes.grid(alpha=0.3)
