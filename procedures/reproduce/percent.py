"""Table 5.8 once more: its percent errors from the experiments and the theories, by both definitions."""

from __future__ import annotations

import numpy as np

from instrument.designs import get_design
from instrument.evidence import Evidence
from instrument.thesis import read_table
from procedures.reproduce.rows import Row, RowTable
from procedures.reproduce.theory import COLUMNS, beam_ratios, sample_moduli, table_ratio


def errors() -> RowTable:
    """Each printed percentage beside both that follow from the thesis' own numbers.

    No scatter is stated for a percentage: nothing is judged, the sentences say which definition fits.
    """
    table, moduli = read_table("5.8"), sample_moduli()
    samples = [row for row in table.rows if row != "average"]
    rows, said = [], []
    for name, (design, _, source, _) in COLUMNS.items():
        measured = get_design(design).thesis_force_ratio
        experiment = np.array([measured[sample] for sample in samples])
        theory = beam_ratios(moduli) if source is None else table_ratio(source, moduli)
        cells = table.columns[f"{name}_error_percent"]
        printed = np.array([cell.value for cell in cells[: len(samples)]])
        misfit = {}
        for definition, base in (("theory", theory), ("experiment", experiment)):
            percent = 100 * (experiment - theory) / base
            misfit[definition] = float(np.sqrt(np.mean((percent - printed) ** 2)))
            with_average = [*percent, float(percent.mean())]
            rows += [
                Row(row, f"{name}_percent_of_{definition}", cell, float(ours), None, Evidence.INPUT)
                for row, cell, ours in zip(table.rows, cells, with_average, strict=True)
            ]
        best = min(misfit, key=lambda definition: misfit[definition])
        said.append(
            f"{name}: percent of the {best} fits best, {misfit[best]:.1f} points rms; of the other"
            f" {max(misfit.values()):.1f}"
        )
    title = "percent error of the experiments against the theories, by both definitions"
    return RowTable("5.8 errors", title, table.doubt, tuple(rows), tuple(said))
