"""Shows uncertainty budgets, one table for each result."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from palpate.procedures.showing.text import new_table, number, stamped


def show_budgets(budgets: Iterable[Mapping[str, Any]], simulated: bool) -> list[object]:
    """Tables with each component's uncertainty, sensitivity, contribution and share of the variance.

    `budgets` are as `Budget.summary` and the record have them.
    """
    shown: list[object] = []
    for given in budgets:
        budget = given.get("budget", given)
        unit = f" {budget['unit']}" if budget["unit"] else ""
        adds = f"adds ({budget['unit']})" if unit else "adds"
        table = new_table(
            stamped(simulated, f"Uncertainty of {budget['quantity']} = {budget['value']:.5g}{unit}"),
            "component", "kind", "u", "sensitivity", adds, "share",
            "degrees of freedom",
        )  # fmt: skip
        table.columns[0].justify = "left"
        for row in budget["components"]:
            table.add_row(
                row["name"], row["kind"], f"{row['u']:.2g}", f"{row['sensitivity']:.3g}",
                f"{abs(row['contribution']):.2g}", f"{row['share']:.1%}", number(row["degrees_of_freedom"]),
            )  # fmt: skip
        related = [
            f"correlation {entry['coefficient']:.3g} of {' and '.join(entry['of'])}" for entry in budget["correlations"]
        ]
        dof = budget["degrees_of_freedom"]
        freedom = "" if dof is None else f" with {dof:.3g} degrees of freedom"
        combined = f"combined {budget['u']:.2g}{unit}{freedom}"
        shown += [
            table,
            *related,
            f"{combined}; {budget['coverage']:.0%} interval ± {budget['expanded']:.2g}{unit}",
            "",
        ]
    return shown
