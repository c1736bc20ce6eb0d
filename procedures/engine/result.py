"""What a procedure finds: its points, its budgets, and its other values for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from palpate.instrument.uncertainty.budget import Budget, Propagated

P = TypeVar("P", bound="DataclassInstance")


class Result(Protocol):
    """The result of a procedure.

    What a plan predicts of its results (`engine/promise.py`) is compared with their budgets. A result may have besides:
    `unbudgeted`, values and standard uncertainties by name of results without a budget; and `achieved_u`, the relative
    standard uncertainty that it reached, or None, where that is not the greatest one among the predicted results.
    """

    @property
    def points(self) -> Sequence[DataclassInstance]:
        """The measured points; their fields have the names of the record."""

    @property
    def budgets(self) -> Sequence[Budget | Propagated]:
        """The uncertainty budgets of the result."""

    def summary(self) -> dict[str, Any]:
        """The result for JSON, without its points."""


@dataclass(frozen=True, slots=True)
class SimpleResult(Generic[P]):
    """A result for a procedure that needs no class of its own.

    Attributes:
        points: the measured points.
        values: the other values, by their names in JSON.
        budgets: the uncertainty budgets.
    """

    points: Sequence[P]
    values: Mapping[str, object] = field(default_factory=dict)
    budgets: Sequence[Budget | Propagated] = ()

    def summary(self) -> dict[str, Any]:
        return dict(self.values)
