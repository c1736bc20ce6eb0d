"""Figures of chapter 5 redrawn: the samples' moduli, and the force ratios of the three arrangements, beside ours."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from instrument.sample import SAMPLES
from procedures.report.figure import new_figure, save
from procedures.report.text import STAMP
from procedures.reproduce.experiments import order_by_modulus
from procedures.reproduce.figures import Picture
from procedures.reproduce.rows import Row, RowTable

AT_3_N = (("5.3", "5.5", "one sensor"), ("5.4", "5.6", "common base"), ("5.5", "5.7", "different bases"))
COMPRESSED = {"5.2": "1", "5.3": "6"}


def draw_chapter_5(tables: Sequence[RowTable], folder: Path) -> list[Picture]:
    """Figures 5.2 to 5.5 sample by sample, and every force ratio over the thesis' own; as PNG."""
    by_number = {table.number: table for table in tables}
    return [_by_sample(by_number, folder), _all_ratios(tables, folder)]


def _by_sample(tables: dict[str, RowTable], folder: Path) -> Picture:
    figure, axes = new_figure(True, 1 + len(AT_3_N))
    figure.suptitle(f"{STAMP}: samples from hard to soft, ours and the thesis'")
    order = order_by_modulus()
    axes[0].plot(order, [1e-3 * SAMPLES[name].modulus for name in order], "k_", ms=14, label="thesis")
    tested = {sample: _last(tables[number], "modulus_Pa") for number, sample in COMPRESSED.items() if number in tables}
    axes[0].errorbar(
        list(tested), [1e-3 * row.ours for row in tested.values()], [1e-3 * (row.u or 0.0) for row in tested.values()],
        fmt="o", ms=4, capsize=2, label="ours",
    )  # fmt: skip
    axes[0].set(title="Figure 5.2: modulus", ylabel="modulus (kPa)")
    for ax, (number, table, title) in zip(axes[1:], AT_3_N, strict=True):
        rows = {row.row: row for row in tables[table].rows if row.quantity == "force_ratio"} if table in tables else {}
        here = [rows[name] for name in order if name in rows]
        ax.plot([row.row for row in here], [row.cell.value for row in here], "k_", ms=14, label="thesis")
        ax.errorbar(
            [row.row for row in here], [row.ours for row in here], [row.u or 0.0 for row in here], fmt="o", ms=4,
            capsize=2, label="ours",
        )  # fmt: skip
        ax.set(title=f"Figure {number}: {title}, 3 N", ylabel="force ratio")
    for ax in axes:
        ax.set(xlabel="sample")
        ax.legend(fontsize=8)
    file = save(figure, folder, "figures_5_2_to_5_5.png")
    return Picture("Figures 5.2 to 5.5", "moduli of the samples, and force ratios under 3 N", "", file)


def _all_ratios(tables: Sequence[RowTable], folder: Path) -> Picture:
    figure, axes = new_figure(True, len(AT_3_N))
    figure.suptitle(f"{STAMP}: every force ratio, ours over the thesis'")
    for ax, (_, _, title) in zip(axes, AT_3_N, strict=True):
        kind = "single" if title == "one sensor" else title
        rows = [r for table in tables if kind in table.title for r in table.rows if r.quantity == "force_ratio"]
        thesis = [row.cell.value for row in rows]
        ax.errorbar(thesis, [row.ours for row in rows], [row.u or 0.0 for row in rows], fmt="o", ms=3, capsize=2)
        ends = [min(thesis, default=0.0), max(thesis, default=1.0)]
        ax.plot(ends, ends, "k-", lw=1)
        ax.set(title=title, xlabel="thesis", ylabel="ours")
    return Picture("Force ratios", "all of Tables A2.9 to A2.20 and 5.5 to 5.7", "", save(figure, folder, "ratios.png"))


def _last(table: RowTable, quantity: str) -> Row:
    return [row for row in table.rows if row.quantity == quantity][-1]
