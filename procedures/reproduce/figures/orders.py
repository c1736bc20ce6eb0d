"""Figures 5.2 to 5.5: the six samples from hard to soft, by their moduli and by the force ratios of three sensors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.thesis import read_table
from palpate.procedures.reproduce.chapter5.experiments import AT_3_N, order_by_modulus
from palpate.procedures.reproduce.figures.measured import Measured
from palpate.procedures.reproduce.figures.picture import THESIS, Picture, canvas, save

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


def draw_moduli(measured: Measured, folder: Path) -> Picture:
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
    return _draw(BY_MODULUS, thesis, ours, caption, folder)


def draw_ratios(design: str, measured: Measured, folder: Path) -> Picture:
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
    return _draw(number, thesis, ours, caption, folder)


def _falling(values: Mapping[str, float]) -> list[str]:
    return sorted(values, key=lambda name: values[name], reverse=True)


def _draw(number: str, thesis: Order, ours: Order, caption: str, folder: Path) -> Picture:
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
