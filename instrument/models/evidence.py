"""What agreement with the thesis is worth: whether our number is the thesis' own, was fitted to it, or is predicted.

A number of ours is made of parts: a mean ratio that the thesis measured, the sensitivity of a film, a model with its
parameters. Each part says which numbers of the thesis went into it. If one part knows nothing of a table, the number is
a prediction of that table: agreement then tests that part.

    of_experiment("force_rigid_N", ratio_by("experiment"), "A2.9")              # Evidence.INPUT
    of_model("force_rigid_N", ratio_by("axisymmetric", "identified"), "4.1")    # Evidence.FITTED
    of_model("force_rigid_N", ratio_by("axisymmetric", "identified"), "A2.2")   # Evidence.PREDICTED
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType

from palpate.instrument.models.parameters import get_parameter_set


class Evidence(Enum):
    """What agreement is worth, in rising order."""

    INPUT = "input"
    FITTED = "fitted"
    PREDICTED = "predicted"

    @property
    def meaning(self) -> str:
        """One sentence that explains it."""
        return _MEANINGS[self]


_MEANINGS: Mapping[Evidence, str] = MappingProxyType(
    {
        Evidence.INPUT: "the thesis' number itself went in: a match shows that the bench hands back what it was given",
        Evidence.FITTED: "parameters were chosen to meet this very table: a match shows that the fit was done well",
        Evidence.PREDICTED: "neither: a match is evidence for the model, and a miss is evidence against it",
    }
)


@dataclass(frozen=True, slots=True)
class EvidencePart:
    """One part of a number of ours.

    Attributes:
        fitted_to: tables of the thesis to which the part was fitted; None: it is a number of the thesis itself.
    """

    fitted_to: frozenset[str] | None

    def evidence(self, tables: Iterable[str]) -> Evidence:
        """Evidence of this part where it is compared with these tables of the thesis."""
        if self.fitted_to is None:
            return Evidence.INPUT
        return Evidence.FITTED if self.fitted_to.intersection(tables) else Evidence.PREDICTED


# Loads, film sensitivities, the load cell's line, moduli of the samples, and the scatter of all of them.
GIVEN = EvidencePart(None)
# The films' voltages are computed from constants of their material.
FILM_MATERIAL = EvidencePart(frozenset())
# Models that are fits with any parameter set: two lengths of the corrected beam were chosen to meet the errors of two
# dimensions, and two numbers of the fitted column to meet the tables for the softer ring.
FITTED_MODELS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"beam": ("5.8",), "beam_exact": ("5.8",), "column_fitted": ("A2.1", "A2.3")}
)
# These tables repeat numbers of another table.
REPEATS: Mapping[str, str] = MappingProxyType(
    {
        "4.1": "A2.1", "4.2": "A2.2", "4.3": "A2.3", "4.4": "A2.4", "4.5": "A2.3", "4.6": "A2.4", "A2.5": "A2.3",
        "A2.6": "A2.4",
    }
)  # fmt: skip
# Table for the stiffer ring -> table of the same sensor with the softer ring; both have the same force ratio at the
# same ratio of moduli.
OTHER_RING: Mapping[str, str] = MappingProxyType({"A2.2": "A2.1", "A2.4": "A2.3"})


def ratio_by(model: str, parameters: str = "physical") -> EvidencePart:
    """The force ratio of a sensor model with a parameter set.

    Raises:
        UnknownName: no such set for the model.
    """
    if model == "experiment":
        return GIVEN
    fits = (*FITTED_MODELS.get(model, ()), *get_parameter_set(parameters, model).fitted_to)
    return EvidencePart(frozenset(fits))


def of_experiment(quantity: str, ratio: EvidencePart, *tables: str) -> Evidence:
    """Evidence of a column of the thesis' experiments, where the bench takes its force ratios from `ratio`.

    The force below the base is the load, and the meter shows it by the load cell's line. No sensor model goes into
    them.
    """
    on_a_tooth = quantity.startswith(("force", "pvdf")) and "total" not in quantity
    return _evidence(tables, [GIVEN, ratio] if on_a_tooth else [GIVEN])


def of_model(quantity: str, ratio: EvidencePart, *tables: str) -> Evidence:
    """Evidence of a column of the thesis' theory. Forces rest on the ratio, voltages also on the film's material."""
    return _evidence(tables, [ratio, FILM_MATERIAL] if quantity.startswith("voltage") else [ratio])


def _evidence(tables: Iterable[str], parts: Iterable[EvidencePart]) -> Evidence:
    """Evidence of a number that is made of these parts and is compared with these tables."""
    held = {*tables, *(REPEATS[table] for table in tables if table in REPEATS)}
    ranks = list(Evidence)
    return max((part.evidence(held) for part in parts), key=ranks.index)
