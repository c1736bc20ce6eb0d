"""What other sessions can do for the modulus of an object before its run: calibrate the films, and the model.

Both are sessions of their own, as a person stands a pin on the teeth or mounts references, and as what they store holds
for all later runs. `prepared` finds how much of them makes the whole quickest.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.instrument.allocation.preparations import Prepared, prepare
from palpate.instrument.allocation.purchase import Preparation, RunOption
from palpate.instrument.calibration.films import FEWEST
from palpate.instrument.errors import PalpateError, RangeError
from palpate.instrument.findings.film_forces import calibration_u
from palpate.instrument.findings.mean_ratio import CALIBRATION
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.models.validation import validate
from palpate.instrument.sensor.design import Design
from palpate.procedures.engine.plan import APPROACH, point_seconds
from palpate.procedures.lab.mounts import MOUNTING
from palpate.procedures.measurements.object_modulus.lines import VALIDATION, ExpectedRatio, Wanted
from palpate.procedures.measurements.object_modulus.prospect import SHORT, fewest_of, way_of

COMPRESSION = 272.0  # s, of the test that tells the modulus of a reference [M]
REFERENCE = 400.0  # s, with that test and the mounting on the sensor [M]
REFERENCE_U = 0.02  # relative standard uncertainty of the modulus of a reference [A]
REFERENCE_SETS = 6  # load sets of each in palpate calibrate model
FILM_DWELL = 1.0  # s, in palpate calibrate films


def references_of(question: RatioQuestion, found: ExpectedRatio, design: Design) -> Preparation | None:
    """References of the model, with those that there are; None: nothing tells how objects spread about a constant."""
    slope, known = found.sensitivity, found.references
    if slope is None:
        return None
    if known is not None:
        made = len(known.calibration.references)
        one, more = known.calibration.with_more(1), known.calibration.with_more(10**9)
        if one is None or more is None or one.u is None or more.u is None:
            return None
        u = slope * math.sqrt(max(one.u**2 - more.u**2, 0.0))
        return Preparation(VALIDATION, u, -COMPRESSION * made, REFERENCE, made + 1, slope * more.u)
    spread = _spread(question.design, question.parameters, found.model)
    if spread is None:
        return None
    own = slope * design.ratio_scatter / math.sqrt(REFERENCE_SETS)
    return Preparation(VALIDATION, math.hypot(slope * spread, REFERENCE_U, own), 0.0, REFERENCE, 1, slope * spread)


@functools.lru_cache(maxsize=16)
def _spread(design: str, parameters: str, model: str) -> float | None:
    """How objects spread about a model's constant, by the thesis' samples; None: they do not tell."""
    try:
        return validate(design, parameters, model).ln_spread
    except PalpateError:
        return None


def films_of(design: Design, found: ExpectedRatio, frequency: float) -> Preparation | None:
    """A calibration of the films, by points on each tooth; None: the ratio only tells a bound of the modulus."""
    if found.sensitivity is None:
        return None
    shared = np.array([[len({*a.teeth} & {*b.teeth}) for b in design.films] for a in design.films])
    count = np.array([len(film.teeth) for film in design.films])
    covariance = np.asarray(design.scatter_covariance) * shared / np.outer(count, count)
    u = calibration_u(replace(design, film_covariance=tuple(map(tuple, covariance.tolist()))))
    teeth, point = len(design.teeth), point_seconds(frequency, FILM_DWELL, first=False)
    return Preparation(CALIBRATION, found.sensitivity * u, teeth * (MOUNTING + APPROACH), teeth * point, FEWEST)


def preparations(question: RatioQuestion, found: ExpectedRatio, wanted: Wanted, design: Design) -> list[Preparation]:
    """Those that replace a line of what is wanted."""
    films = None
    if design.film_covariance is not None and not (found.films_cancel and not wanted.relative):
        films = films_of(design, found, wanted.frequency)
    references = None if wanted.relative else references_of(question, found, design)
    return [each for each in (films, references) if each is not None]


def prepared(
    question: RatioQuestion, found: ExpectedRatio, wanted: Wanted, design: Design, loads: Sequence[float]
) -> Prepared | None:
    """The quickest way to the tolerance in all; None: nothing reaches it, or a time alone is given."""
    if wanted.tolerance is None or found.sensitivity is None:
        return None
    ways: list[RunOption] = [way_of(design, found, wanted, load, cycles) for load in loads for cycles in SHORT]
    try:
        return prepare(ways, wanted.tolerance, preparations(question, found, wanted, design), fewest_of(wanted))
    except RangeError:
        return None
