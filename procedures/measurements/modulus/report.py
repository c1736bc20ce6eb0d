"""Shows and plots the result of a compression test."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.findings.compression import CompressionPoint
from palpate.instrument.quantity import show, show_with_u
from palpate.instrument.thesis import COMPRESSION_TABLES, ThesisTable, read_table
from palpate.instrument.uncertainty.budget import Propagated
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.modulus.result import ModulusResult
from palpate.procedures.records.columns import Column
from palpate.procedures.showing.figure import name_all, new_figure, save
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import MARKS, OUTSIDE, legend, new_table, stamped

if TYPE_CHECKING:
    from rich.table import Table as RichTable


def _calibrated(point: CompressionPoint) -> str:
    return "no" if point.extrapolated else "yes"


COMPRESSED = {  # what is printed of a `CompressionPoint`
    "direction": Column(head="direction"),
    "position_m": Column(head="position\nmm", cell="z.3f", scale=1e3),
    "reading_mV": Column(head="meter\nmV", cell="z.1f"),
    "load_N": Column(head="load\nN", cell="z.3f"),
    "extrapolated": Column(head="calibrated", cell=_calibrated),
    "strain": Column(head="strain", cell="z.4f"),
    "strain_u": Column(head="u", cell="z.4f"),
    "stress_Pa": Column(head="stress\nkPa", cell="z.2f", scale=1e-3),
    "stress_u": Column(head="u", cell="z.2f", scale=1e-3),
    "secant_modulus_Pa": Column(head="secant modulus\nkPa", cell="z.1f", scale=1e-3),
    "secant_modulus_u": Column(head="u", cell="z.1f", scale=1e-3),
}


def show_modulus(result: ModulusResult, outcome: Outcome) -> list[object]:
    """The steps, the moduli with the thesis' values, and the bench's compliance."""
    sample, c = result.sample, result.compression
    title = f"Compression of sample {sample.name} ({sample.material})"
    steps = table_of(stamped(outcome["simulated"], title), c.points, COMPRESSED)
    thesis, loss = _thesis(sample.name), c.energy_loss
    return [
        steps,
        *legend(steps, marks={"no": MARKS[OUTSIDE]}),
        *(() if thesis is None else (_printed(thesis),)),
        f"tangent modulus    {_value(c.tangent)}   (thesis: {show(sample.modulus, 'Pa')}, {sample.source})",
        f"secant modulus     {_value(c.secant)}, at the largest strain",
        f"unloading modulus  {_value(c.unloading)}",
        f"thickness          {_value(c.thickness)}, by the contacts on pad and bare support",
        f"bench              yields {1e3 * c.compliance.value:z.4f} mm/N, u = {1e3 * c.compliance.u:z.4f}, corrected",
        f"linearity          {100 * c.linearity:z.2f} % of the span",
        f"energy loss        {100 * loss.value:z.1f} % of the work of loading, u = {100 * loss.u:.2g} %",
        *(() if thesis is None else (f"Table {thesis.number}: {thesis.doubt}",)),
    ]


def plot_modulus(result: ModulusResult, simulated: bool, folder: Path) -> Path:
    """Plot stress and secant modulus against strain, with the thesis' values; returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"compression of sample {result.sample.name}")
    for direction, marker in (("loading", "^"), ("unloading", "v")):
        points = [p for p in result.compression.points if p.direction == direction]
        strain, strain_u = [p.strain for p in points], [p.strain_u for p in points]
        for axes, values, u in (
            (left, [p.stress_Pa for p in points], [p.stress_u for p in points]),
            (right, [p.secant_modulus_Pa for p in points], [p.secant_modulus_u for p in points]),
        ):
            axes.errorbar(
                strain, [1e-3 * v for v in values], [1e-3 * v for v in u], strain_u, fmt=marker, capsize=2,
                label=direction,
            )  # fmt: skip
    thesis = _thesis(result.sample.name)
    if thesis is not None:
        strain = list(thesis.values("strain"))
        label = f"thesis Table {thesis.number}"
        left.plot(strain, 1e-3 * thesis.values("stress_Pa"), "k_", ms=10, label=label)
        right.plot(strain, 1e-3 * thesis.values("modulus_Pa"), "k_", ms=10, label=label)
    tangent = result.compression.tangent
    right.axhline(1e-3 * tangent.value, color="k", lw=1, label="tangent modulus")
    left.set(xlabel="strain", ylabel="stress (kPa; bars: u)")
    right.set(xlabel="strain", ylabel="secant modulus (kPa; bars: u)", ylim=(0, None))
    name_all(left)
    name_all(right, 2)
    return save(figure, folder)


def _thesis(sample: str) -> ThesisTable | None:
    """The thesis' compression test of a sample; None: it has none (it tests two samples)."""
    return read_table(COMPRESSION_TABLES[sample]) if sample in COMPRESSION_TABLES else None


def _printed(table: ThesisTable) -> RichTable:
    rows = new_table(
        stamped(False, f"Thesis, Table {table.number}"), "position\nmm", "strain", "stress\nkPa", "modulus\nkPa"
    )
    cells = (table.values(name) for name in ("strain", "stress_Pa", "modulus_Pa"))
    for position, strain, stress, modulus in zip(table.rows, *cells, strict=True):
        rows.add_row(position, f"{strain:z.4f}", f"{1e-3 * stress:z.2f}", f"{1e-3 * modulus:z.1f}")
    return rows


def _value(found: Propagated) -> str:
    value, u = show_with_u(found.value, found.u, found.budget.unit)
    return f"{value}, u = {u}"
