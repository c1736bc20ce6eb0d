"""Tables 4.3 to 4.6 and A2.3 to A2.6: two sensors, on a common base or on different ones, on both rings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.instrument.thesis import ThesisTable, read_table
from palpate.procedures.reproduce.chapter4.films import voltage_sentence
from palpate.procedures.reproduce.chapter4.prediction import prediction_sentences
from palpate.procedures.reproduce.curves import TOOTH, CurveCase, Curves, ring_of
from palpate.procedures.reproduce.judging.criterion import odds_sentence
from palpate.procedures.reproduce.judging.rows import Comparison, column_of, fit_sentence

GOAL = 0.015
# Design of each table, and the table of the same layout on a common base.
TWINS = {"4.3": "4.5", "4.4": "4.6", "A2.5": "A2.3", "A2.6": "A2.4"}
DESIGNS = {
    **dict.fromkeys(TWINS, "different_base"),
    **dict.fromkeys(TWINS.values(), "common_base"),
}


def cases(parameters: Sequence[str], design: str, ring: float) -> dict[tuple[str, str], CurveCase]:
    """Cases that a table for a ring [Pa] needs, by parameter set and model."""
    return {(name, "solid"): CurveCase(design, "solid", name, ring) for name in parameters}


def compare(number: str, parameters: Sequence[str], curves: Curves) -> Comparison:
    """One of the eight tables. Each tooth film takes half of the teeth's force."""
    table, design = read_table(number), DESIGNS[number]
    moduli, ring = table.keys(), ring_of(table)
    by = {key: curves.of(case) for key, case in cases(parameters, design, ring).items()}
    ratio = {key: curve.force_ratio(moduli) for key, curve in by.items()}
    half = {key: values / 2 for key, values in ratio.items()}
    voltage = {key: curve.voltage(TOOTH, moduli) for key, curve in by.items()}
    ours = {"force_ratio": (ratio, GOAL), "force_pvdf": (half, None), "voltage": (voltage, None)}
    columns = tuple(
        column_of(table, name, *given)
        for kind, given in ours.items()
        for name in sorted(table.columns)
        if name.startswith(kind)
    )
    comparison = Comparison(table, columns, ())
    sensor = next(iter(by.values())).sensor
    over = {f"{name} set ({model})": voltage[name, model] / half[name, model] for name, model in half}
    said = [
        fit_sentence(comparison, "force_ratio"),
        odds_sentence(table, design),
        *prediction_sentences(comparison, "force_ratio"),
        voltage_sentence(
            table, "voltage_pvdf1_V", abs(table.values("force_pvdf1_N")), sensor, TOOTH, over
        ),
    ]  # fmt: skip
    if number in TWINS:
        said.append(twin_sentence(table, read_table(TWINS[number])))
        apart = [
            f"{float(np.abs(ratio[key] - curves.of(other).force_ratio(moduli)).max()):.1g} by the {key[0]} set"
            for key, other in cases(parameters, "common_base", ring).items()
        ]
        said.append(
            "the model's ratio on different bases differs from that on a common one by at most " + ", ".join(apart)
        )
    return Comparison(table, columns, tuple(said))


def twin_sentence(table: ThesisTable, twin: ThesisTable) -> str:
    """Sentence that tells how many cells of a different-base table equal those of the common-base one."""
    pairs = [
        (float(table.values(name)[row]), float(twin.values(other)[row]))
        for name, other in (
            ("voltage_pvdf1_V", "voltage_pvdf1_V"), ("voltage_pvdf3_V", "voltage_pvdf2_V"),
            ("force_pvdf1_N", "force_pvdf1_N"), ("force_pvdf3_N", "force_pvdf2_N"), ("force_ratio", "force_ratio"),
        )
        for row in range(len(table.rows))
    ]  # fmt: skip
    same = sum(ours == theirs for ours, theirs in pairs)
    verdict = "it is a copy, not an independent result" if same == len(pairs) else "the two are not independent"
    return f"{same} of {len(pairs)} cells, repaired, are those of Table {twin.number}: {verdict}"
