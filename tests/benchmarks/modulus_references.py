"""Three references, measured as `calibrate model` measures them but with drawn ratios, for a truth off its curve."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np

from palpate.instrument.calibration.model_calibration import MeasuredReference, ModelCalibration, fit_model
from palpate.instrument.findings.object_modulus import ByReferences
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.validation import Validation, validate
from palpate.procedures.measurements.object_modulus.planning import expected
from tests.benchmarks.modulus_bench import MODEL, Draws, Truth

REFERENCES = (25e3, 75e3, 200e3)  # Pa; none of them is an object of the campaign
STATED = 0.02  # relative standard uncertainty of their moduli
SETS = 6
ABOUT = {
    "design": "single", "model": MODEL, "parameters": "physical", "thickness_m": 3e-3, "device": "drawn",
    "simulated": True, "source": "drawn", "created": "2000-01-01T00:00:00+00:00", "expires": "2100-01-01",
}  # fmt: skip


@functools.cache
def _by_the_curve(modulus: float) -> tuple[float, float]:
    """Force ratio and sensitivity of an object by the model."""
    found = expected(RatioQuestion("single", MODEL), modulus)
    return found.ratio, found.sensitivity or math.nan


@functools.cache
def _known() -> Validation:
    return validate("single", "physical", MODEL)


def calibrated(truth: Truth) -> ByReferences:
    """The model's calibration on the bench of a truth; each reference is as far off its stated modulus as it may be."""
    chance, measured = np.random.default_rng([3, truth.seed]), []
    for number, modulus in enumerate(REFERENCES):
        real = replace(truth, modulus=modulus)
        draws, scatter = Draws(real), real.scene.design.ratio_scatter
        logs = [math.log(draws.ratio(round(1e9 * (number * 100 + each)), number)) for each in range(SETS)]
        ratio, slope = _by_the_curve(modulus)
        stated = modulus * math.exp(STATED * float(chance.standard_normal()))
        ratio *= (stated / modulus) ** (1 / slope)
        measured.append(
            MeasuredReference(
                f"reference {number}", stated, STATED, "stated", math.exp(math.fsum(logs) / SETS),
                scatter / math.sqrt(SETS), 0.0, 0.0, ratio, slope,
            )
        )  # fmt: skip
    found: ModelCalibration = fit_model(measured, _known(), ABOUT)
    return ByReferences(found)
