"""Prints possible causes of the difference between models and the thesis' experiments, and their size."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.instrument.models.validation import SIGN
from palpate.procedures.accuracy.what_if import mean_of
from palpate.procedures.showing.text import new_table, print_all, stamped

if TYPE_CHECKING:
    from palpate.instrument.models.validation import Validation
    from palpate.procedures.accuracy.causes import Causes


def print_causes(found: Causes) -> None:
    """Print one line for each cause, then the results of stiffening springs, wrong gains and the readings."""
    table = new_table(
        stamped(False, f"solid model, coarsest mesh, {SIGN}"), "what if", "cause", "single\nmean", "single\nrms",
        "common base\nmean", "common base\nrms", "pair over\nsingle",
    )  # fmt: skip
    table.columns[0].justify = table.columns[1].justify = "left"
    for effect in found.effects:
        cells = [f"{value:{form}}" for each in effect.by_design.values() for value, form in _mean_and_rms(each)]
        table.add_row(effect.what_if.name, effect.what_if.cause, *cells, f"{effect.contrast:.3f}")
    table.add_row("measured", "", "", "", "", "", f"{mean_of(found.measured_contrasts):.3f}")
    contrasts = [
        f"pair over single by sample, {name}: " + ", ".join(f"{sample}: {value:.2f}" for sample, value in of.items())
        for name, of in (("measured", found.measured_contrasts), ("as described", found.effects[0].contrasts))
    ]
    stiffer = [
        f"rubber that stiffens (neo-Hookean springs), moduli times {each.times:g}, {each.force:g} N: the ratio of a"
        f" single sensor is {each.over_linear:.2f} times that of linear springs"
        for each in found.stiffening
    ]
    gains = [
        f"one gain for all readings of {gain.design}: measured ratios times {gain.factor:.3f} meet model 'surface' to"
        f" {gain.left:.1f} % rms"
        for gain in found.gains
    ]
    copies = [
        f"common base, {each.film}: {each.same} of {each.cells} printed readings are {each.how}"
        for each in found.readings
    ]
    print_all(table, *contrasts, "", *stiffer, "", *gains, "", *copies)


def _mean_and_rms(found: Validation) -> list[tuple[float, str]]:
    return [(found.mean or 0.0, "+.1f"), (found.rms or 0.0, ".1f")]
