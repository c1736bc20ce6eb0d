"""Report of the models' distances from the experiments of the thesis, and of possible causes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from palpate.instrument.models.validation import SIGN, Validation
from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.accuracy.what_if import mean_of
from palpate.procedures.showing.text import new_table, print_all, stamped

if TYPE_CHECKING:
    from palpate.procedures.accuracy.causes import Causes


def brief(found: Validation) -> str:
    """Text of a table's cell: the rms distance, or one word that says why there is none."""
    return found.kind if found.rms is None else f"{found.rms:.0f} %"


def lines(found: Iterable[Validation], changed: Sequence[str] = ()) -> list[str]:
    """A sentence for each model on its distance from the experiments.

    Args:
        found: comparisons.
        changed: options that differ from the parameter set; only the set itself was compared.
    """
    told = []
    for each in found:
        said = f"validation of {each.model} ({each.parameters} set, {each.design}): "
        if each.mean is None or each.rms is None or each.worst is None:
            told.append(f"{said}{each.kind}: {each.why}")
            continue
        by_sample = ", ".join(f"{name}: {value:+.0f}" for name, value in each.percent.items())
        told.append(
            f"{said}mean {each.mean:+.1f} %, rms {each.rms:.1f} %, worst {each.worst:+.1f} % at sample"
            f" {each.worst_sample} ({SIGN}; by sample {by_sample})"
        )
    if changed:
        told.append(f"the validation is that of the set as it stands, without {', '.join(changed)}")
    return told


def print_validation(compared: Sequence[Validation]) -> None:
    """Print one table for each design, with one line for each model and parameter set."""
    for design in dict.fromkeys(each.design for each in compared):
        table = new_table(
            stamped(False, f"{design}: {SIGN}"), "model", "set", *(f"sample {name}" for name in SAMPLES), "mean",
            "rms", "worst",
        )  # fmt: skip
        table.columns[0].justify = table.columns[1].justify = "left"
        reasons = []
        for each in (found for found in compared if found.design == design):
            if each.kind == "compared":
                cells = [f"{each.percent[name]:+.1f}" if name in each.percent else "-" for name in SAMPLES]
                table.add_row(
                    each.model, each.parameters, *cells, f"{each.mean:+.1f}", f"{each.rms:.1f}", f"{each.worst:+.1f}"
                )
            else:
                table.add_row(each.model, each.parameters, *["-"] * len(SAMPLES), each.kind, "", "")
                reasons.append(f"{each.model}, {each.parameters}: {each.kind}: {each.why}")
        print_all(table, *reasons, "")


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
