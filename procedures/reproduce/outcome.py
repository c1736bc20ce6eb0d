"""What reproducing the whole thesis has come to so far: models, tables, verdicts, and the page."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate.instrument.models.evidence import Evidence
from palpate.instrument.models.validation import SIGN, Validation
from palpate.procedures.reproduce.judging.criterion import Verdict, judge
from palpate.procedures.reproduce.judging.rows import Row, RowTable
from palpate.procedures.reproduce.models import Reproduction


@dataclass(slots=True)
class Everything:
    """Everything that is done so far: the models' part, tables of rows with their files, and the page."""

    models: Reproduction
    tables: list[tuple[RowTable, Path]] = field(default_factory=list)
    orders: dict[str, bool] = field(default_factory=dict)
    order_evidence: dict[str, Evidence] = field(default_factory=dict)
    blind: list[Validation] = field(default_factory=list)
    page: Path | None = None

    def all_tables(self) -> list[RowTable]:
        """Tables of the experiments and tables of the models."""
        return [table for table, _ in self.tables] + [found.row_table() for found, _ in self.models.tables]

    def verdicts(self) -> dict[Evidence, Verdict]:
        """Verdict on each class of rows."""
        return judge(self.all_tables())

    def outside(self) -> list[tuple[str, Row]]:
        """Rows outside their stated scatter, with their table."""
        return [(table.number, row) for table in self.all_tables() for row in table.judged if not row.within]

    def met(self) -> bool:
        """Whether every class meets its requirement and the orders are right."""
        return all(verdict.met for verdict in self.verdicts().values()) and all(self.orders.values())

    def summary(self) -> dict[str, Any]:
        """The summary with the names that JSON has."""
        return {
            "evidence": {evidence.value: verdict.record() for evidence, verdict in self.verdicts().items()},
            "softness_order_right": self.orders,
            "softness_order_evidence": {design: each.value for design, each in self.order_evidence.items()},
            "blind": {"sign": SIGN, "runs": [found.record() for found in self.blind]},
            "met": self.met(),
            "outside": [{"table": number, **row.record()} for number, row in self.outside()],
        }
