"""How far sensor models are from the experiments of the thesis."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from palpate.instrument.models.validation import SIGN, Validation
from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.showing.text import new_table, print_all, stamped


def brief(found: Validation) -> str:
    """Text of a table's cell: the rms distance, or one word that says why there is none."""
    return found.kind if found.rms is None else f"{found.rms:z.0f} %"


def lines(found: Iterable[Validation], changed: Sequence[str] = ()) -> list[str]:
    """A sentence for each model on its distance from the experiments.

    Args:
        found: comparisons.
        changed: settings that differ from the parameter set's; only the set itself was compared.
    """
    shown = []
    for each in found:
        head = f"validation of {each.model} ({each.parameters} set, {each.design}): "
        if each.mean is None or each.rms is None or each.worst is None:
            shown.append(f"{head}{each.kind}: {each.why}")
            continue
        by_sample = ", ".join(f"{name}: {value:+z.0f}" for name, value in each.percent.items())
        shown.append(
            f"{head}mean {each.mean:+z.1f} %, rms {each.rms:z.1f} %, worst {each.worst:+z.1f} % at sample"
            f" {each.worst_sample} ({SIGN}; by sample {by_sample})"
        )
    if changed:
        options = [f"--{name.replace('_', '-')}" for name in changed]
        shown.append(f"the validation is that of the set as it stands, without {', '.join(options)}")
    return shown


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
                cells = [f"{each.percent[name]:+z.1f}" if name in each.percent else "-" for name in SAMPLES]
                table.add_row(
                    each.model, each.parameters, *cells, f"{each.mean:+z.1f}", f"{each.rms:z.1f}", f"{each.worst:+z.1f}"
                )
            else:
                table.add_row(each.model, each.parameters, *["-"] * len(SAMPLES), each.kind, "", "")
                reasons.append(f"{each.model}, {each.parameters}: {each.kind}: {each.why}")
        print_all(table, *reasons, "")
