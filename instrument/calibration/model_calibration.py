"""Calibration of a sensor model by references, objects of known modulus: a constant and the spread about it.

    found.line(same_films=True)              # what is left of the model's validation error

The curve of the model is divided by the constant. `model_fit` finds it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from palpate.instrument.calibration.calibration import Calibration
from palpate.instrument.config import Config, Name, NotNegative, Positive
from palpate.instrument.errors import ConfigError
from palpate.instrument.models.validation import ValidationLine, remedy
from palpate.instrument.quantity import counted, show

if TYPE_CHECKING:
    from palpate.instrument.models.ratio import RatioQuestion

REACH = 3.0  # factor between moduli


class CalibratedReference(Config):
    """A reference as the calibration keeps it: see MeasuredReference."""

    model_config = ConfigDict(strict=True)

    name: Name
    modulus_Pa: Positive
    modulus_u: Positive
    source: Name
    force_ratio: Positive
    force_ratio_u: NotNegative
    films_u: NotNegative
    pickup_u: NotNegative
    model_force_ratio: Positive
    sensitivity: Positive
    ln_error: float
    ln_error_u: NotNegative


class ModelCalibration(Calibration):
    """Calibration of a model for one sensor. The field names are the keys of the calibration file.

    Args:
        design, model, parameters, thickness_m: sensor, model and its parameter set, and thickness of the references.
        constant: ln of the model's ratio over the measured one.
        constant_u: its standard uncertainty by moduli, scatter and noise of the references; 0 where `spread` holds it.
        films_u, pickup_u: parts of its uncertainty by the films' calibration and by pick-up, which do not average out.
        films_degrees_of_freedom: degrees of freedom of `films_u`; None: infinitely many.
        spread, spread_degrees_of_freedom: standard deviation of objects about the constant; None: not known.
        weight: share of the spread's variance that the constant has: 1 over the number of equal references.
        prior: what the spread rests on, in words.
        film_calibration: SHA-256 of the films' calibration; None: the design's sensitivities held.
        device: serial number of the sensor node.
    """

    file: ClassVar[str] = "calibration of a model"
    kind: ClassVar[str] = "model"
    make: ClassVar[str] = "run palpate calibrate model"

    design: Name
    model: Name
    parameters: Name
    thickness_m: Positive
    references: Annotated[tuple[CalibratedReference, ...], Field(min_length=1)]
    constant: float
    constant_u: NotNegative
    films_u: NotNegative
    films_degrees_of_freedom: Positive | None = None
    pickup_u: NotNegative
    spread: NotNegative | None = None
    spread_degrees_of_freedom: Positive | None = None
    weight: Positive
    prior: Name
    film_calibration: Name | None = None

    @property
    def of(self) -> tuple[str, ...]:
        return self.design, self.model, self.parameters, show(self.thickness_m, "m")

    def line(self, same_films: bool) -> ValidationLine:
        """What is left of the validation error, for the ratio of an object.

        Args:
            same_films: whether the object is measured with the films' calibration of the references; it then cancels.
        """
        told = f"{counted(len(self.references), 'reference')} of {self.source}{self.marks()}"
        if self.spread is None or self.spread_degrees_of_freedom is None:
            why = f"{told} gives a constant, and nothing tells the spread about it"
            return ValidationLine(self.constant, None, math.inf, f"not known: {why}; {remedy(self.model)}, two or more")
        told = f"{told}, {self.prior}"
        if self.film_calibration is not None:
            told += (
                "; the films' calibration is the same and cancels"
                if same_films
                else "; their films' calibration counts"
            )
        films = 0.0 if same_films else self.films_u
        spread = self.spread * math.sqrt(1 + self.weight)
        u = math.hypot(spread, self.constant_u, self.pickup_u, films)
        spent = spread**4 / self.spread_degrees_of_freedom + films**4 / (self.films_degrees_of_freedom or math.inf)
        return ValidationLine(self.constant, u, u**4 / spent if spent > 0 else math.inf, told)

    def with_more(self, references: int) -> ValidationLine | None:
        """The line if there were so many references, like the present ones and of the same spread; None: not known."""
        count = len(self.references)
        if self.spread is None or self.spread_degrees_of_freedom is None:
            return None
        spread = self.spread * math.sqrt(1 + 1 / references)
        one = math.fsum(each.ln_error_u**2 for each in self.references) / count if self.constant_u else 0.0
        u = math.hypot(spread, math.sqrt(one / references), self.pickup_u)
        freedom = self.spread_degrees_of_freedom + (references - count) * telling(self.spread, one)
        known = u**4 * freedom / spread**4 if spread > 0 else math.inf
        return ValidationLine(self.constant, u, known, counted(references, "reference"))

    def reaches(self, moduli: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the constant is taken to hold at some moduli [Pa]: up to three times beyond the references' own."""
        known = [each.modulus_Pa for each in self.references]
        return (moduli >= min(known) / REACH) & (moduli <= max(known) * REACH)

    def check_question(self, question: RatioQuestion, model: str) -> None:
        """Check that the calibration is of the model that answers a question, and its sensor and object.

        Raises ConfigError.
        """
        modulus = question.sensor().ring.material.modulus
        plain = replace(question, settings={}, at=None)
        load = plain.load(modulus)
        own = self.design, self.model, self.parameters
        if own != (question.design, model, question.parameters):
            asked = f"design {question.design}, model {model}, set {question.parameters}"
            raise ConfigError(
                f"the calibration of a model by {self.source} is for design {self.design}, model {self.model}, set"
                f" {self.parameters}, not for {asked}; {self.make}"
            )
        alike = replace(load, sensed=replace(load.sensed, thickness=self.thickness_m))
        if question.sensor() != plain.sensor() or question.load(modulus) != alike:
            raise ConfigError(
                f"the calibration of a model by {self.source} is for the parameter set as it stands and objects of"
                f" {show(self.thickness_m, 'm')}; leave out {', '.join(question.changed) or 'the settings'}, or give"
                " that thickness"
            )

    def check_films(self, films: str | None) -> None:
        """Check that the constant holds with a films' calibration of that SHA-256. Raises ConfigError.

        What the design's sensitivities are off by is in the constant of uncalibrated films, and not in others.
        """
        if (self.film_calibration is None) != (films is None):
            then, now = ("no", "one") if films is not None else ("one", "none")
            raise ConfigError(
                f"was made with {then} calibration of the films, and now there is {now}; {self.make}, or delete it"
            )


def telling(spread: float, variance: float) -> float:
    """Degrees of freedom that one more reference of some variance of its own gives a spread: 1 if it has none.

    The variance of an estimate of spread² grows with (spread² + variance)².
    """
    return (spread**2 / (spread**2 + variance)) ** 2
