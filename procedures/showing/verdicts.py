"""Shows the verdicts of limits, one row for each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.instrument.quantity import show, show_with_u
from palpate.instrument.uncertainty.decision import PASS
from palpate.procedures.engine.verdict import percent
from palpate.procedures.showing.text import new_table, stamped

if TYPE_CHECKING:
    from palpate.procedures.engine.verdict import Judgement, LimitVerdict


def show_verdicts(judged: Judgement, simulated: bool) -> list[object]:
    """Each limit with its value and what was known beforehand, and below the table why one does not pass."""
    table = new_table(
        stamped(simulated, "Verdicts"), "limit", "value", "u", "low", "high", "risk", "prior", "outside", "verdict"
    )
    table.columns[0].justify = "left"
    for each in judged.verdicts:
        ends = ("-" if limit is None else show(limit, each.unit) for limit in (each.low, each.high))
        outside = "-" if each.outside is None else percent(each.outside)
        table.add_row(each.quantity, *_value(each), *ends, percent(each.risk), _prior(each), outside, each.outcome)
    others = (each for each in judged.verdicts if each.outcome != PASS)
    return [table, *(f"{each.outcome:<14} {each.quantity}: {each.reason}" for each in others)]


def _value(verdict: LimitVerdict) -> tuple[str, str]:
    if verdict.value is None:
        return "-", "-"
    if verdict.u is None:
        return show(verdict.value, verdict.unit), "-"
    return show_with_u(verdict.value, verdict.u, verdict.unit)


def _prior(verdict: LimitVerdict) -> str:
    if verdict.prior is None:
        return "none"
    mean, sd = show_with_u(verdict.prior.mean, verdict.prior.sd, verdict.unit)
    return f"normal {mean}, sd {sd}"
