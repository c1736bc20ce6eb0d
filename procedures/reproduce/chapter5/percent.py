"""Table 5.8: percent errors of our bench's experiments against our models, beside the thesis'.

All errors are the experiment less the theory, so that an experiment above the theory has a positive error. They are
percent of the theory for the single sensor and percent of the experiment for the two others, because with that the
thesis' own numbers give its percentages.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.evidence import Evidence
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.thesis import TableCell, ThesisTable, read_table
from palpate.procedures.measurements.loads import SweepResult
from palpate.procedures.reproduce.chapter4.theory import COLUMNS, beam_ratios, sample_moduli, table_ratio
from palpate.procedures.reproduce.judging.rows import WITHIN, Comparison, Row, RowCorrelation, RowTable

Array = NDArray[np.float64]

AVERAGE = "average"
GOAL = 0.012  # for a theory's force ratio, as in Tables A2.1 and A2.3
SLIPPED = 0.5  # percent points; a slip in the thesis' own theory that changes less does not count


def definitions() -> RowTable:
    """Each printed percentage beside the two that follow from the thesis' own numbers, else from the beam.

    No scatter is known for a percentage, so nothing is judged. The sentences say which definition fits.
    """
    table = read_table("5.8")
    rows, said = [], []
    for name in COLUMNS:
        cells = table.columns[f"{name}_error_percent"]
        by, evidence = "the thesis", Evidence.INPUT
        if COLUMNS[name][2] is None:  # there are no printed numbers; the beam that was fitted to this table gives them
            by, evidence = "the thesis against beam", Evidence.FITTED
        misfit = {}
        for definition in ("theory", "experiment"):
            percent = _by_the_thesis(name, definition == "experiment")
            misfit[definition] = _rms(percent, cells)
            rows += [
                Row(row, f"{name}_percent_of_{definition}", cell, float(ours), None, evidence, by=by)
                for row, cell, ours in zip(table.rows, cells, percent, strict=True)
            ]
        best = min(misfit, key=lambda definition: misfit[definition])
        said.append(
            f"{name}, {by}: percent of the {best} fits best, {misfit[best]:.1f} points rms; of the other"
            f" {max(misfit.values()):.1f}"
        )
    title = "the thesis' own numbers, in percent of the theory and of the experiment: which it means"
    return RowTable(
        "5.8 (definitions)", title, table.doubt, tuple(rows), tuple(said), name="5_8_definitions", again=True
    )


def of_bench(theories: Comparison, swept: Mapping[str, SweepResult]) -> RowTable:
    """Our experiments against our models, by the thesis' definitions.

    The scatter holds that of our mean ratios, half the goal of a theory, and the distance of the thesis' percentages
    from those that its own numbers give. Experiments and theories are judged and counted in tables of their own.

    Args:
        theories: Table 5.8 by the models: force ratios at the samples' moduli.
        swept: sweeps of the bench, by design.
    """
    table, rows, averages = read_table("5.8"), [], []
    for name, (design, _, source, of_experiment) in COLUMNS.items():
        means = {mean.sample: mean for mean in swept[design].samples}
        measured = [means[sample] for sample in table.rows if sample != AVERAGE]
        experiment, u = (
            np.array([np.nan if value is None else value for value in values])
            for values in ([m.force_ratio for m in measured], [m.force_ratio_u for m in measured])
        )
        column = next(c for c in theories.columns if c.quantity.startswith(name))
        cells = _repaired(table, name, source, of_experiment)
        misfit = 0.0 if source is None else _rms(_by_the_thesis(name, of_experiment), cells)
        for series in column.ours:
            theory = series.values
            ours = percent_errors(experiment, theory, of_experiment)
            base = experiment if of_experiment else theory
            # Scatter of the error by experiment and by theory. For the average the theory's errors are fully
            # correlated.
            by_experiment = 100 * u * (theory / experiment if of_experiment else 1.0) / base
            by_theory = 100 * (GOAL / WITHIN) * (1.0 if of_experiment else experiment / theory) / base
            each = np.sqrt(by_experiment**2 + by_theory**2 + misfit**2)
            of_mean = np.sqrt((np.sum(by_experiment**2) + len(u) * misfit**2) / len(u) ** 2 + np.mean(by_theory) ** 2)
            evidence, by = column.evidence(series, table), f"{series.model}, {series.parameters}"
            averages.append(
                f"{name}, average: {ours[-1]:+.1f} % by {by} ({evidence.value}), the thesis {cells[-1].printed} %"
                + (f", without its slip {cells[-1].value:.1f} %" if cells[-1].reason else "")
            )
            rows += [
                Row(
                    row, f"{name}_percent", cell, float(found), float(spread), evidence, False,
                    by=f"bench against {by}",
                    # The theory is one curve, so all rows share its part.
                    group=RowCorrelation(f"{name}_percent", float(spread), float(np.mean(by_theory))),
                )
                for row, cell, found, spread in zip(table.rows, cells, ours, [*each, of_mean], strict=True)
            ]  # fmt: skip
    said = (
        "sign: the experiment less the theory, positive where the experiment lies above; percent of the theory for the"
        " single sensor, of the experiment for common and different bases, as the thesis has it",
        "the experiments are the bench's mean ratios, into which the thesis' own means went; fitted or predicted"
        " is the theory, and the error with it",
        *averages,
    )
    title = "percent errors of our bench's experiments against our models"
    return RowTable("5.8", title, table.doubt, tuple(rows), said, name="5_8_percent", again=True)


def percent_errors(experiment: Array, theory: Array, of_experiment: bool) -> Array:
    """The experiment less the theory in percent of either, for each sample, and their average."""
    percent = 100 * (experiment - theory) / (experiment if of_experiment else theory)
    return np.append(percent, percent.mean())


def _by_the_thesis(name: str, of_experiment: bool, printed: bool = False) -> Array:
    """Percentages of a column by the thesis' own means and its own theory, as printed or as repaired."""
    design, _, source, _ = COLUMNS[name]
    measured, moduli = get_design(design).thesis_force_ratio, sample_moduli()
    experiment = np.array([measured[row] for row in read_table("5.8").rows if row != AVERAGE])
    theory = beam_ratios(moduli) if source is None else table_ratio(source, moduli, printed)
    return percent_errors(experiment, theory, of_experiment)


def _rms(percent: Array, cells: Sequence[TableCell]) -> float:
    """Root mean square of the samples' differences, without the average."""
    return float(np.sqrt(np.mean((percent - [cell.value for cell in cells])[:-1] ** 2)))


def _repaired(table: ThesisTable, name: str, source: str | None, of_experiment: bool) -> list[TableCell]:
    """The printed percentages; where they follow from a slip in the theory's own table, those of the repaired table."""
    cells = list(table.columns[f"{name}_error_percent"])
    if source is None:
        return cells
    right, slipped = (_by_the_thesis(name, of_experiment, printed) for printed in (False, True))
    reason = f"thesis slip: its theory is the shifted column of Table {source}"
    return [
        TableCell(cell.printed, float(without), reason)
        if abs(without - with_it) > SLIPPED and abs(cell.value - with_it) < abs(cell.value - without)
        else cell
        for cell, without, with_it in zip(cells, right, slipped, strict=True)
    ]
