"""The one call for all models: force on the teeth and signals of the films under a load.

    load = Load(force=3.0, sensed=get_sample("2"))
    response(get_design("single"), load, model="axisymmetric", tolerance=1e-4).force_ratio

Every model here is linear in the force.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models.film import signals
from palpate.instrument.models.parameters import get_parameter_set
from palpate.instrument.models.price_list import model_errors
from palpate.instrument.models.table import MODELS, Response
from palpate.instrument.quantity import check_tolerance
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import Load

# --- one load ------------------------------------------------------------------------------------------


AUTO = "auto"


def response(design: Design, load: Load, model: str = "experiment", tolerance: float | None = None) -> Response:
    """Forces on teeth and base under one load; see `responses`."""
    (found,) = responses(design, [load], model, tolerance)
    return found


def responses(
    design: Design, loads: Sequence[Load], model: str = "experiment", tolerance: float | None = None
) -> list[Response]:
    """Forces on teeth and base, by a model, or by the cheapest one that meets the tolerance ("auto").

    Args:
        design: the sensor.
        loads: loads on it, which differ in the modulus of their object alone. A finite-element model is set up once.
        model: one of MODELS, or "auto".
        tolerance: greatest error of the force ratio, relative to it; None: the model's own.

    Raises:
        UnknownName: there is no such model.
        RangeError: the model does not answer for this design or load, or not to this tolerance, which must be above
            0 and at most 0.5.
        EstimateError: a linear system cannot be solved accurately.
    """
    if tolerance is not None:
        check_tolerance(tolerance, f"tolerance {tolerance:g}")
    if model == AUTO:
        from palpate.instrument.models.price_list import answers_cheapest

        return answers_cheapest(design, loads, tolerance)
    if model not in MODELS:
        raise UnknownName("model", model, (*MODELS, AUTO))
    chosen = MODELS[model]
    if tolerance is not None and chosen.default_tolerance is None:
        refining = [name for name, other in MODELS.items() if other.default_tolerance is not None]
        raise RangeError(
            f"tolerance {tolerance:g}: model {model!r} has no error estimate to refine by;"
            f" leave it out, or ask {AUTO!r} or one of {', '.join(refining)}"
        )
    return chosen.answers(design, loads, tolerance)


# --- a list of moduli ----------------------------------------------------------------------------------

# question = Question("single_round", "axisymmetric", "physical", {"compliant_modulus": 33e3}, tolerance=1e-4)
# [answer.response.force_ratio for answer in ask(question, [14.9e3, 24e3])]


# Settings of a caller that override the parameter set.
SETTINGS = (
    "compliant_modulus",
    "sensed_thickness",
    "sensed_poisson",
    "compliant_poisson",
    "plate_modulus",
    "interface",
)
# Settings that a model holds fixed: the program takes the plate's thickness for the object's, an experiment was done
# once, and fitted numbers are not known for other bodies.
FIXED: dict[str, tuple[str, ...]] = {
    "beam_printed": ("sensed_thickness",),
    "column_fitted": tuple(name for name in SETTINGS if name != "compliant_modulus"),
    "experiment": tuple(name for name in SETTINGS if name != "sensed_thickness"),
}


@dataclass(frozen=True, slots=True)
class RatioQuestion:
    """A question for the force ratio of a sensor.

    Attributes:
        design: name of a design.
        model: name of a model of `table.MODELS`, or "auto".
        parameters: name of a parameter set.
        settings: values that override the parameter set, moduli in Pa and lengths in m (see SETTINGS).
        tolerance: greatest error of the force ratio, relative to it; None: the model's own.
        at: point of the object in which the force acts, (x, y) from its corner [m]; None: a uniform pressure.

    Raises:
        UnknownName: no such design, model, parameter set of that model, or setting.
        RangeError: a setting that the model holds fixed.
    """

    design: str
    model: str
    parameters: str = "physical"
    settings: Mapping[str, float | str] = field(default_factory=dict)
    tolerance: float | None = None
    at: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        get_design(self.design)
        if self.model not in (*MODELS, AUTO):
            raise UnknownName("model", self.model, (*MODELS, AUTO))
        get_parameter_set(self.parameters, self.model)
        for name in self.settings:
            if name not in SETTINGS:
                raise UnknownName("setting of a model", name, SETTINGS)
            if name in FIXED.get(self.model, ()):
                raise RangeError(
                    f"{name} {self.settings[name]}: model {self.model!r} always takes its own value; leave it out"
                )

    @property
    def changed(self) -> list[str]:
        """Names of what is not as the parameter set has it."""
        return [*self.settings, *(["at"] if self.at else [])]

    def sensor(self) -> Design:
        """The design with the materials of parameter set and settings."""
        design = get_parameter_set(self.parameters, self.model).design(get_design(self.design))
        ring, plate = design.ring, design.plate
        ring = replace(ring, material=replace(ring.material, **self._set("compliant_")))
        plate = replace(plate, material=replace(plate.material, **self._set("plate_")))
        return replace(design, ring=ring, plate=plate)

    def load(self, modulus: float) -> Load:
        """Load of 1 N through the object with that modulus [Pa]."""
        load = get_parameter_set(self.parameters, self.model).load(modulus)
        sensed = replace(load.sensed, **self._set("sensed_"))
        interface = str(self.settings.get("interface", load.interface))
        return replace(load, sensed=sensed, interface=interface, at=self.at)

    def _set(self, kind: str) -> dict[str, Any]:
        return {name.removeprefix(kind): value for name, value in self.settings.items() if name.startswith(kind)}


@dataclass(frozen=True, slots=True)
class RatioAnswer:
    """Response to 1 N through an object with a modulus [Pa].

    Attributes:
        seconds: time of all answers that were asked for together, over their number [s].
        model_error: distance of the model from the reference (see `price_list.model_error`), relative to the ratio.
    """

    sensed_modulus: float
    response: Response
    seconds: float
    model_error: float | None = None

    def summary(self, design: Design) -> dict[str, Any]:
        """Under public names, with what the films of the design give."""
        given = self.response
        return {
            "sensed_modulus_Pa": self.sensed_modulus,
            "force_ratio": given.force_ratio,
            "error_estimate": given.error_estimate,
            "model_error": self.model_error,
            "model": given.model,
            "why": given.why,
            "seconds": self.seconds,
            "films": {
                name: {
                    "force_N": film.force,
                    "plane_stress_Pa": film.plane_stress,
                    "charge_C": film.charge,
                    "voltage_V": film.voltage,
                    "voltage_error_V": film.voltage_error,
                }
                for name, film in signals(design, given).items()
            },
        }


def ask(question: RatioQuestion, moduli: Sequence[float]) -> list[RatioAnswer]:
    """Responses at moduli of the sensed object [Pa]. A finite-element model is set up once for all.

    Raises:
        RangeError: a modulus or setting is outside its limits, or the model cannot answer for it or to the tolerance.
        UnknownName: there is no such interface.
        EstimateError: a linear system cannot be solved accurately.
    """
    design, loads = question.sensor(), [question.load(modulus) for modulus in moduli]
    start = time.perf_counter()
    given = responses(design, loads, question.model, question.tolerance)
    seconds = (time.perf_counter() - start) / len(loads)
    errors = model_errors(design, loads, [each.model for each in given])
    return [
        RatioAnswer(load.sensed.modulus, each, seconds, None if error is None else error / each.force_ratio)
        for load, each, error in zip(loads, given, errors, strict=True)
    ]
