"""What references are expected to give: the uncertainty of a model's constant, as its budget has it.

The ratios are those of the model for the references' moduli, which need not be true: the constant is unknown before.
Objects are expected to spread about it as the thesis' samples do [M]; where that is not known, no spread is expected.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from palpate.instrument.findings.film_forces import calibration_u, pickup_u
from palpate.instrument.models.curve import RatioCurve
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.models.validation import validate
from palpate.instrument.sensor.design import Design
from palpate.procedures.engine.promise import Expected
from palpate.procedures.measurements.prospects import expected_mean
from palpate.procedures.measurements.references.reference import Reference
from palpate.procedures.measurements.references.result import check_range


def expected_constant(
    design: Design,
    references: Sequence[Reference],
    question: RatioQuestion,
    curve: RatioCurve,
    loads: Sequence[float],
    dwell: float,
) -> list[Expected]:
    """Relative uncertainty of each reference's mean ratio, and that of the factor between curve and real ratios.

    Args:
        design: design of the sensor.
        references: the references.
        question: names the model and its parameter set.
        curve: the model's curve.
        loads: load of each load set, peak to peak [N].
        dwell: dwell of each [s].
    """
    means, ratios, own = [], [], []
    for each in references:
        ratio = float(curve.force_ratio(each.modulus))
        mean = expected_mean(f"force ratio of {each.name}", design, ratio, loads, [dwell] * len(loads))
        shared = ratio * math.hypot(calibration_u(design), pickup_u(design) * math.hypot(1.0, 1 / ratio))
        means.append(Expected.of(mean))
        ratios.append(ratio)
        own.append(math.sqrt(mean.u**2 - shared**2) / ratio)
    spread = validate(question.design, question.parameters, curve.model).ln_spread or 0.0
    weights = [
        1 / (spread**2 + u**2 + (each.u / check_range(each, curve)) ** 2)
        for u, each in zip(own, references, strict=True)
    ]
    pickup = math.fsum(pickup_u(design) * math.hypot(1.0, 1 / ratio) for ratio in ratios) / len(ratios)
    constant = math.hypot(1 / math.sqrt(math.fsum(weights)), calibration_u(design), pickup)
    return [*means, Expected(f"constant of model {curve.model}", constant, "ln")]
