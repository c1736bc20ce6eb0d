"""What is wanted of an object's modulus, what a model expects of it, and the lines of its uncertainty.

found = expected(question, 48e3)                      # ratio 0.27, sensitivity 2.0
lines_of(design, found, 3.0, wanted, absolute=False)  # under a load of 3 N
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from palpate.instrument.allocation.lines import BudgetLine, RepeatUnit
from palpate.instrument.findings.film_forces import calibration_u, pickup_u
from palpate.instrument.findings.mean_ratio import CALIBRATION, NOISE, PICKUP, PRIOR_FREEDOM, SCATTER
from palpate.instrument.findings.modulus_of_ratio import MOST_SENSITIVE, modulus_of_ratio
from palpate.instrument.findings.object_modulus import ByReferences, estimate, validation_of
from palpate.instrument.models.curve import RatioCurve, corrected, ratio_curve
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.sine_columns import sine_columns
from palpate.procedures.engine.plan import expected_noise
from palpate.procedures.lab.mounts import BY_HAND, Mounts
from palpate.procedures.steps.films import SAMPLES_PER_CYCLE

MOUNTED, CURVE, VALIDATION = "mounting scatter", "discretisation", "validation"
EDGE = 1e-9  # distance that an expected ratio keeps from 0 and 1
USUAL = 10.0  # Hz
LONG = 20  # cycles, from which on trend and hum cost nothing of a dwell


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is asked for.

    Attributes:
        tolerance: relative standard uncertainty of the modulus; None: as good as the time allows.
        time: bench time [s]; None: as long as the tolerance takes.
        relative: whether the tolerance is about the model's scale, without the validation error.
        frequency: frequency of the load [Hz].
        mountings: number of mountings; None: as many as pay.
        mounted: relative standard deviation of the ratio from mounting to mounting; None: not known.
        mounted_freedom: its degrees of freedom; infinite where it is stated.
        mounted_by: where it comes from, for people; empty: it is stated, or not known.
        mounts: who mounts the object, and how long that takes.
        sample: name of the object, if it is one of the rubber samples; empty: it is none.
    """

    tolerance: float | None
    time: float | None
    relative: bool
    frequency: float
    mountings: int | None
    mounted: float | None
    mounted_freedom: float = math.inf
    mounted_by: str = ""
    mounts: Mounts = BY_HAND
    sample: str = ""


@dataclass(frozen=True, slots=True)
class ExpectedRatio:
    """What a model expects of an object.

    Attributes:
        ratio: force ratio.
        sensitivity: relative change of the modulus over that of the ratio; None: the ratio says too little of it.
        curve_u: standard uncertainty of the ratio by the model's discretisation.
        validation: the model's validation error.
        model: name of the model that answers.
        references: the model's calibration by references; None: there is none.
    """

    ratio: float
    sensitivity: float | None
    curve_u: float
    validation: ValidationLine
    model: str
    references: ByReferences | None = None

    @property
    def films_cancel(self) -> bool:
        """Whether the error of the films' calibration cancels in the absolute modulus, because references share it."""
        return self.references is not None and self.references.same_films


def curve_of(question: RatioQuestion, references: ByReferences | None = None) -> RatioCurve:
    """The curve of the question's model, corrected by references if there are some. Raises as `ratio_curve` does."""
    sensor = question.sensor()
    curve = ratio_curve(sensor, question.load(sensor.ring.material.modulus), question.model, question.tolerance)
    return curve if references is None else corrected(curve, validation_of(question, curve.model, references).constant)


def sensitivity_at(curve: RatioCurve, ratio: float) -> float | None:
    """Relative change of the modulus over that of the ratio; None: the ratio is only good for a bound."""
    found = modulus_of_ratio(curve, [min(max(ratio, EDGE), 1 - EDGE)])
    slope = float(found.sensitivity[0])
    return slope if slope <= MOST_SENSITIVE and math.isfinite(found.modulus[0]) else None


def expected(question: RatioQuestion, modulus: float, references: ByReferences | None = None) -> ExpectedRatio:
    """What the question's model expects of an object of a Young modulus [Pa].

    Raises:
        RangeError: the model does not answer for this sensor. EstimateError: a system cannot be solved accurately.
    """
    curve = curve_of(question, references)
    low, high = curve.moduli
    ratio = float(curve.force_ratio([min(max(modulus, low), high)])[0])
    ratio = min(max(ratio, EDGE), 1 - EDGE)
    (row,) = estimate(question, [ratio], EDGE, references=references)
    sensitivity = sensitivity_at(curve, ratio) if low <= modulus <= high else None
    line = validation_of(question, row["model"], references)
    return ExpectedRatio(ratio, sensitivity, row["curve_error"] / math.sqrt(3), line, row["model"], references)


def lines_of(
    design: Design, found: ExpectedRatio, load: float, wanted: Wanted, absolute: bool, cycles: int = LONG
) -> tuple[BudgetLine, ...]:
    """Lines of the modulus' uncertainty. A scatter of mountings that is not known has no line.

    Args:
        design: the sensor.
        found: what the model expects of the object.
        load: load, peak to peak [N].
        wanted: what is asked for.
        absolute: whether the validation error counts.
        cycles: number of cycles of the load in a dwell.
    """
    slope, ratio = found.sensitivity or MOST_SENSITIVE, found.ratio
    films, pickup = calibration_u(design), pickup_u(design) * math.hypot(1.0, 1 / ratio)
    noise = expected_noise(design, load, ratio) * cost_of_trend(min(cycles, LONG))
    lines = [
        BudgetLine(SCATTER, slope * design.ratio_scatter, RepeatUnit.SET, PRIOR_FREEDOM),
        BudgetLine(NOISE, slope * noise, RepeatUnit.SECOND),
        BudgetLine(CURVE, slope * found.curve_u / ratio, RepeatUnit.NOTHING),
    ]
    if wanted.mounted:
        lines.append(BudgetLine(MOUNTED, slope * wanted.mounted, RepeatUnit.MOUNTING, wanted.mounted_freedom))
    if films and not (absolute and found.films_cancel):
        lines.append(BudgetLine(CALIBRATION, slope * films, RepeatUnit.NOTHING, design.film_freedom or math.inf))
    if pickup:
        lines.append(BudgetLine(PICKUP, slope * pickup, RepeatUnit.NOTHING))
    if absolute and found.validation.u is not None:
        validation = found.validation
        lines.append(
            BudgetLine(VALIDATION, slope * (validation.u or 0.0), RepeatUnit.NOTHING, validation.degrees_of_freedom)
        )
    return tuple(lines)


@functools.cache
def cost_of_trend(cycles: int) -> float:
    """Noise of an amplitude that is fitted to some cycles, over that which falls with the square root of their number.

    Trend and hum are fitted, too, and one cycle alone hardly tells them from the drive.
    """
    weights = sine_columns(np.arange(cycles * SAMPLES_PER_CYCLE) / SAMPLES_PER_CYCLE / USUAL, USUAL).weights()
    return float(np.linalg.norm(weights)) * math.sqrt(cycles * SAMPLES_PER_CYCLE) / 2
