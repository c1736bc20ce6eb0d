"""Tables 5.1 to 5.4: the load cell and the rubbers, beside a calibration and compressions on the simulated bench."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.findings.compression import LOADING
from palpate.instrument.models.evidence import GIVEN
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.thesis import TableCell, read_table
from palpate.procedures.measurements.load_cell.result import LoadCellResult
from palpate.procedures.measurements.modulus.result import ModulusResult
from palpate.procedures.reproduce.judging.rows import Row, RowCorrelation, RowTable

DIGIT_U = math.sqrt(2 / 3)  # mV: both readings are known to ±1 digit
WENT_IN = GIVEN.evidence(())  # load cell and rubbers are simulated by the thesis' own line and moduli


def calibration(found: LoadCellResult) -> RowTable:
    """Table 5.1: readings under dead weights, and the line through them."""
    table = read_table("5.1")
    ours = {(p.direction, round(p.load_gf)): p.reading_mV for p in found.points}
    rows = [
        Row(row, column, table.columns[column][index], ours[direction, round(float(row))], DIGIT_U, WENT_IN)
        for index, row in enumerate(table.rows)
        for direction, column in (("loading", "reading_loading_mV"), ("unloading", "reading_unloading_mV"))
    ]
    line, thesis = found.calibration, THESIS_LOAD_CELL
    for name, value, u in (
        ("sensitivity_mV_per_N", line.sensitivity_mV_per_N, line.sensitivity_u),
        ("zero_mV", line.zero_mV, line.zero_u),
    ):
        cell = TableCell("", float(getattr(thesis, name)), "not printed: the line through the readings")
        rows.append(Row("line", name, cell, value, u, WENT_IN))
    said = (
        f"sensitivity {thesis.sensitivity_mV_per_N:.3f} mV/N by the line; the printed 0.1053 mV/N is mV per gram-force,"
        f" {0.1053 / 9.80665e-3:.2f} mV/N, and takes no zero into account",
    )
    return RowTable("5.1", table.title, table.doubt, tuple(rows), said)


def compression(number: str, sample: str, found: ModulusResult) -> RowTable:
    """Tables 5.2 and 5.3: stress and secant modulus at the thesis' strains, ours along the loading line."""
    table, c = read_table(number), found.compression
    printed = table.values("modulus_Pa")
    spread = float(printed.std(ddof=1))
    points = [p for p in c.points if p.direction == LOADING]
    tangent, tangent_u = c.tangent.value, c.tangent.u
    rows = []
    u = math.hypot(spread, tangent_u)
    for index, row in enumerate(table.rows):
        strain = table.columns["strain"][index].value
        for name, ours, scale in (("stress_Pa", tangent * strain, strain), ("modulus_Pa", tangent, 1.0)):
            group = RowCorrelation(name, u * scale, tangent_u * scale)  # one line of ours gives all rows
            rows.append(Row(row, name, table.columns[name][index], ours, u * scale, WENT_IN, group=group))
    mean = float(printed.mean())
    group = RowCorrelation("mean modulus", tangent_u, 0.0)
    rows.append(Row("mean", "modulus_Pa", TableCell(f"{mean:.1f}", mean), tangent, tangent_u, WENT_IN, group=group))
    said = (
        f"sample {sample}: ours up to a strain of {max(p.strain for p in points):.2f}, by the face of 1 cm2 and the"
        " calibration of Table 5.1; the scatter stated is that of the thesis' moduli, and our standard uncertainty",
        "the readings themselves are not compared: at the printed moduli they would be 9.5 times smaller",
    )
    return RowTable(number, table.title, table.doubt, tuple(rows), said)


def catalogue(tested: Mapping[str, ModulusResult]) -> RowTable:
    """Table 5.4: whether the modulus of each rubber, tested or else stored, lies in its range."""
    table = read_table("5.4")
    low, high = table.values("compression_deflection_min_Pa"), table.values("compression_deflection_max_Pa")
    rows = []
    for index, row in enumerate(table.rows):
        ours = tested[row].compression.tangent.value if row in tested else SAMPLES[row].modulus
        cell = TableCell(f"{low[index]:g} to {high[index]:g}", float(np.mean([low[index], high[index]])))
        # Half the range is two standard uncertainties, so that a modulus inside the range is within.
        rows.append(Row(row, "modulus_Pa", cell, ours, float(high[index] - low[index]) / 4, WENT_IN))
    said = ("thesis: the middle of the catalogue's range; half the range counts as two standard uncertainties",)
    return RowTable("5.4", table.title, table.doubt, tuple(rows), said)
