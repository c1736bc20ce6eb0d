"""The plan of a measurement of a modulus, or why there is none."""

from __future__ import annotations

from palpate.instrument.allocation.allocate import BelowFloor
from palpate.instrument.findings.object_modulus import ByReferences
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.sensor.design import Design
from palpate.procedures.measurements.object_modulus.lines import Wanted, expected
from palpate.procedures.measurements.object_modulus.prospect import Prospect, best_of, for_bound
from palpate.procedures.measurements.object_modulus.refusal import (
    below_floor,
    check_mountings,
    not_known,
    too_many_sets,
)
from palpate.procedures.measurements.repeated_sets import MOST_SETS


def prospect_of(
    question: RatioQuestion,
    modulus: float,
    design: Design,
    loads: tuple[float, ...],
    references: ByReferences | None,
    wanted: Wanted,
) -> Prospect:
    """The plan for an object of which a Young modulus [Pa] is expected, under one of some loads [N]."""
    found, tolerance = expected(question, modulus, references), wanted.tolerance
    if found.sensitivity is None:
        return for_bound(found, wanted, loads[0])
    if tolerance is not None and found.validation.u is None and not wanted.relative:
        raise not_known(wanted, found, design, loads)
    try:
        prospect = best_of(design, found, wanted, loads)
    except BelowFloor as error:
        raise below_floor(wanted, question, found, design, loads, error) from None
    if tolerance is not None:
        check_mountings(wanted, found, tolerance)
    if prospect.allocation.sets > MOST_SETS:
        raise too_many_sets(wanted, found, design, loads, prospect)
    return prospect
