"""Prints uncertainty budgets, one table for each result."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from palpate.procedures.showing.text import new_table, number, print_all, stamped

if TYPE_CHECKING:
    from palpate.instrument.uncertainty.budget import Budget


def print_budgets(budgets: Iterable[Budget], simulated: bool) -> None:
    """Print each component with its uncertainty, sensitivity, contribution and share of the variance."""
    for budget in budgets:
        known = budget.summary()
        unit = f" {budget.unit}" if budget.unit else ""
        table = new_table(
            stamped(simulated, f"Uncertainty of {budget.quantity} = {budget.value:.5g}{unit}"),
            "component", "kind", "u", "sensitivity", f"adds{unit and f' ({budget.unit})'}", "share",
            "degrees of freedom",
        )  # fmt: skip
        table.columns[0].justify = "left"
        for row in known["components"]:
            table.add_row(
                row["name"], row["kind"], f"{row['u']:.2g}", f"{row['sensitivity']:.3g}",
                f"{abs(row['contribution']):.2g}", f"{row['share']:.1%}", number(row["degrees_of_freedom"]),
            )  # fmt: skip
        related = [
            f"correlation {entry['coefficient']:.3g} of {' and '.join(entry['of'])}" for entry in known["correlations"]
        ]
        dof = known["degrees_of_freedom"]
        freedom = "" if dof is None else f" with {dof:.3g} degrees of freedom"
        print_all(
            table,
            *related,
            f"combined {budget.u:.2g}{unit}{freedom}; {known['coverage']:.0%} interval ± {known['expanded']:.2g}{unit}",
            "",
        )
