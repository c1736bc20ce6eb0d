"""The plan and the course of a measurement of a modulus: kept, because the same question comes with every set."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Protocol

from palpate.instrument.allocation.allocate import BelowFloor
from palpate.instrument.findings.object_modulus import ByReferences, answering
from palpate.instrument.models.ratio import Question
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.measurements.object_modulus.course import Course
from palpate.procedures.measurements.object_modulus.lines import Wanted, curve_of, expected
from palpate.procedures.measurements.object_modulus.prospect import Prospect, best_of, for_bound
from palpate.procedures.measurements.object_modulus.refusal import (
    below_floor,
    check_mountings,
    not_known,
    too_many_sets,
)
from palpate.procedures.measurements.repeated_sets import MOST_SETS


class Asked(Protocol):
    """What a procedure asks: of which object, to what tolerance or in what time, and by which model."""

    def __hash__(self) -> int: ...

    @property
    def object(self) -> Sample: ...

    def model_question(self, design: Design) -> Question: ...


@functools.lru_cache(maxsize=16)
def question_of(design: str, model: str, thickness: float) -> Question:
    """The question for a model by its own name: "auto" answers only for moduli for which its error is known."""
    asked = Question(design, model, settings={"sensed_thickness": thickness})
    return replace(asked, model=answering(asked))


@functools.lru_cache(maxsize=16)
def prospect_of(
    procedure: Asked,
    design: Design,
    loads: tuple[float, ...],
    references: ByReferences | None,
    wanted: Wanted,
) -> Prospect:
    """The plan of a procedure for one of some loads [N]; the same question comes with every set."""
    question = procedure.model_question(design)
    found, tolerance = expected(question, procedure.object.modulus, references), wanted.tolerance
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


@functools.lru_cache(maxsize=16)
def course_of(
    procedure: Asked,
    design: Design,
    loads: tuple[float, ...],
    references: ByReferences | None,
    wanted: Wanted,
) -> Course:
    question = procedure.model_question(design)
    prospect = prospect_of(procedure, design, loads, references, wanted)
    return Course(design, question, curve_of(question, references), wanted, prospect)
