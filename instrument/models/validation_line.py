"""The validation error of a sensor model as one line of an uncertainty budget.

    line = validation_u("single", "physical", "surface")
    line.u, line.degrees_of_freedom          # 0.245, 6: standard uncertainty of ln of the force ratio

Without references it is the rms of the model's errors against the experiments of the thesis, their mean included: one
more object on one more bench may lie as far off as those samples do. References, objects of known modulus, replace it
by a constant and its uncertainty (`palpate calibrate model`). Where neither is known, nothing is assumed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol


def remedy(model: str) -> str:
    """What would tell the validation error of a model."""
    return f"measure references: palpate calibrate model --model {model}"


@dataclass(frozen=True, slots=True)
class ValidationLine:
    """What is known of the distance between a model's curve and real force ratios.

    Attributes:
        constant: ln of the model's ratio over the measured one, by which the curve is corrected; 0 without references.
        u: standard uncertainty that is left of ln of the ratio; None: not known.
        degrees_of_freedom: degrees of freedom of `u`.
        source: where it comes from; where `u` is None, why it is not known and what would tell it.
    """

    constant: float
    u: float | None
    degrees_of_freedom: float
    source: str

    def summary(self) -> dict[str, Any]:
        """Under the names of JSON; None for infinitely many degrees of freedom, or none."""
        freedom = self.degrees_of_freedom if self.u is not None and math.isfinite(self.degrees_of_freedom) else None
        return {**asdict(self), "degrees_of_freedom": freedom}


class Calibrated(Protocol):
    """A calibration of a model by references."""

    def line(self, same_films: bool) -> ValidationLine:
        """Constant and validation error that the references found."""


def validation_u(
    design: str,
    parameters: str,
    model: str,
    calibration: Calibrated | None = None,
    changed: Sequence[str] = (),
    same_films: bool = False,
) -> ValidationLine:
    """Validation error of a model with a parameter set on a design.

    Args:
        design, parameters, model: names.
        calibration: calibration of this model by references; None: the experiments of the thesis tell.
        changed: names of settings by which the sensor or the object differ from those of the thesis.
        same_films: whether the references were measured with the films' calibration of the object, which then cancels.

    Raises:
        UnknownName: there is no such design, set or model.
        ConfigError: kept answers of the models are damaged.
    """
    if calibration is not None:
        return calibration.line(same_films)
    if changed:
        return _unknown(model, f"the thesis has no experiment with other values of {', '.join(changed)}")
    from palpate.instrument.models.validation import validate

    found = validate(design, parameters, model)
    if found.kind == "input":
        return _unknown(
            model,
            f"model {model!r} is the thesis' measurement itself, and moduli of its samples are known by catalogue"
            " ranges alone",
        )
    if found.ln_rms is None:
        return _unknown(model, found.why)
    count = len(found.percent)
    return ValidationLine(0.0, found.ln_rms, count, f"rms distance from {count} samples of the thesis")


def _unknown(model: str, why: str) -> ValidationLine:
    return ValidationLine(0.0, None, math.inf, f"not known: {why}; {remedy(model)}")
