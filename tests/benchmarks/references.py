"""How often the 95 % interval by references holds an object, with its spread known from the thesis' samples or not.

Samples of the thesis, references and the object are drawn about one constant with one spread; references have an
uncertainty of their modulus and load sets of their own. The object's own load sets are left out: they are known.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from palpate.instrument.calibration.model_calibration import MeasuredReference, fit_model
from palpate.instrument.errors import EstimateError
from palpate.instrument.models.validation import Validation
from palpate.instrument.uncertainty.budget import coverage_factor
from tests.benchmarks.row import Row

TIMES = 4000
SENSITIVITY, MODULUS_U, SCATTER = 2.0, 0.02, 0.041 / math.sqrt(6)
SAMPLES, MEAN = "123456", 0.24  # of the thesis, and the mean of ln of the model's ratio over the measured one
WITHIN, OVER = (0.93, 0.97), (0.9, 1.1)
ORIGIN = {
    "design": "single", "model": "surface", "parameters": "physical", "thickness_m": 3e-3, "device": "drawn",
    "simulated": True, "source": "drawn", "created": "2026-11-23", "expires": "2027-11-23",
}  # fmt: skip


def measure() -> Iterator[Row]:
    """A row for each number of references and spread."""
    for told in (True, False):
        for count in (1, 2, 3, 6) if told else (2, 3, 6):
            for spread in (0.02, 0.053):
                share, over = covered(TIMES, count, spread, told=told)
                met = (WITHIN[0] <= share <= WITHIN[1] and OVER[0] <= over <= OVER[1]) if told else share >= WITHIN[0]
                yield Row(
                    f"{count} references, spread {100 * spread:g} %, {'with' if told else 'without'} the thesis",
                    f"{100 * share:.1f} % held, errors over u {over:.2f}",
                    "93 to 97 %, 0.9 to 1.1" if told else "93 % or more",
                    met,
                )


def covered(times: int, count: int, spread: float, *, told: bool) -> tuple[float, float]:
    """Share of objects that the interval holds, and the standard deviation of errors over the mean uncertainty.

    Args:
        times: number of draws; those whose references are refused do not count.
        count: number of references.
        spread: standard deviation of ln of the ratio about the constant.
        told: whether the thesis tells a spread.
    """
    rng = np.random.default_rng(20)
    held, errors, uncertainties = 0, [], []
    for _ in range(times):
        known = Validation("single", "physical", "surface", "input")
        if told:
            drawn = 100 * np.expm1(MEAN + spread * rng.standard_normal(len(SAMPLES)))
            known = Validation("single", "physical", "surface", "compared", "", dict(zip(SAMPLES, drawn, strict=True)))
        *truth, sought = MEAN + spread * rng.standard_normal(count + 1)
        measured = truth + math.hypot(MODULUS_U / SENSITIVITY, SCATTER) * rng.standard_normal(count)
        try:
            line = fit_model([_reference(n, error) for n, error in enumerate(measured)], known, ORIGIN).line(True)
        except EstimateError:
            continue
        assert line.u is not None
        held += abs(sought - line.constant) <= coverage_factor(line.degrees_of_freedom) * line.u
        errors.append(sought - line.constant)
        uncertainties.append(line.u)
    return held / len(errors), float(np.std(errors) / np.mean(uncertainties))


def _reference(number: int, error: float) -> MeasuredReference:
    name, ratio = f"R{number}", 0.25
    own = ratio * math.exp(-error)
    return MeasuredReference(name, 48e3, MODULUS_U, "drawn", own, SCATTER, 0.0, 0.0, ratio, SENSITIVITY)
