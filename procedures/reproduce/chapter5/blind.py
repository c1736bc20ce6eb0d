"""Blind runs: the whole bench with force ratios by models that know nothing of the thesis' experiments.

The thesis' scenes normally give the measured means. Here the same scenes give force ratios by finite elements, with the
materials as the thesis tells them ("physical"), and with the set that was fitted to the thesis' finite elements
("identified"). The means of these sweeps are compared with the measured means. All differences are model less measured
mean, in percent of the measured mean.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.instrument.models.evidence import of_experiment, ratio_by
from palpate.instrument.models.validation import SIGN, Validation
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.thesis import TableCell, read_table
from palpate.procedures.measurements.loads.result import SweepResult
from palpate.procedures.reproduce.chapter4 import theory
from palpate.procedures.reproduce.chapter5.columns import RATIO
from palpate.procedures.reproduce.chapter5.experiments import AT_3_N, Arrangement
from palpate.procedures.reproduce.judging.rows import Row, RowTable

MODEL = "surface"  # of the solid model, because it answers at once
SETS = ("physical", "identified")
OTHER_SIGN = "the columns of percent below keep the sign of Table 5.8, which is the other one: experiment less theory"
# Column of Table 5.8 with the thesis' own finite elements, for each design.
OWN_THEORY = {
    design: name for name, (design, _, source, _) in theory.COLUMNS.items() if source is not None
}  # fmt: skip


def loads_of(arrangement: Arrangement) -> tuple[float, ...]:
    """Three of an arrangement's loads [N]. Models are linear in the load, and each load takes a second."""
    return arrangement.loads[0], AT_3_N, arrangement.loads[-1]


def compare(arrangement: Arrangement, parameters: str, swept: SweepResult) -> tuple[RowTable, Validation]:
    """Means of a sweep by a parameter set beside the measured means, for each sample."""
    design = get_design(arrangement.design)
    ratio = ratio_by(MODEL, parameters)
    tables = tuple(arrangement.tables.values()) or (arrangement.summary,)  # these print the means
    means = {mean.sample: mean for mean in swept.samples}
    rows, percent = [], {}
    for sample in SAMPLES:
        measured, mean = design.thesis_force_ratio[sample], means[sample]
        ours, ours_u = mean.force_ratio or math.nan, mean.force_ratio_u or math.nan
        u = math.hypot(design.ratio_scatter * measured / math.sqrt(arrangement.averaged), ours_u)
        evidence = of_experiment(RATIO, ratio, *tables)
        rows.append(
            Row(sample, RATIO, TableCell(f"{measured:g}", measured), ours, u, evidence, by=f"{MODEL}, {parameters}")
        )
        percent[sample] = 100 * (ours / measured - 1)
    found = Validation(design.name, parameters, MODEL, "compared", percent=percent)
    title = f"blind run of {design.name}, which knows nothing of the means beside it"
    said = (distance_sentence(found), _own_theory(design.name), OTHER_SIGN)
    number = f"{' to '.join(dict.fromkeys((tables[0], tables[-1])))}, {parameters} set"
    name = f"blind_{design.name}_{parameters}"
    return RowTable(number, title, "", tuple(rows), said, name=name), found


def distance_sentence(found: Validation) -> str:
    """Sentence on the distance from the measured means."""
    by_sample = ", ".join(f"{sample} {value:+.0f} %" for sample, value in found.percent.items())
    return (
        f"{found.design}, {found.parameters} set by model {found.model!r}: mean {found.mean:+.1f} %,"
        f" rms {found.rms:.1f} %, worst {found.worst:+.1f} % ({SIGN}); by sample: {by_sample}"
    )


def _own_theory(design: str) -> str:
    """Sentence on the thesis' own finite elements with the same sign, rebuilt from the errors of Table 5.8."""
    column = OWN_THEORY[design]
    *_, of_experiment_ = theory.COLUMNS[column]
    rebuilt = theory.implied(column)[theory.OF_EXPERIMENT if of_experiment_ else theory.OF_THEORY]
    samples = [sample for sample in read_table("5.8").rows if sample != "average"]
    measured = np.array([get_design(design).thesis_force_ratio[sample] for sample in samples])
    percent = 100 * (rebuilt / measured - 1)
    by_sample = ", ".join(f"{sample} {value:+.0f} %" for sample, value in zip(samples, percent, strict=True))
    return (
        f"{design}, the thesis' own three-dimensional finite elements, rebuilt from Table 5.8: mean"
        f" {percent.mean():+.1f} % by the same sign; by sample: {by_sample}"
    )
