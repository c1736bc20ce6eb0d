"""The force ratio of a named sensor, by a named model, from a named parameter set.

    question = Question("single_round", "axisymmetric", "physical", {"compliant_modulus": 33e3}, tolerance=1e-4)
    ask(question, [14.9e3, 24e3])[0].force_ratio

An error estimate is that of the discretisation. What a model leaves out by its nature, such as the Poisson ratios in
the column model or the corners of the square plates in the axisymmetric one, is in no estimate.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from instrument.design import Design
from instrument.designs import get_design
from instrument.errors import RangeError, UnknownName
from instrument.models import axisymmetric, beam, experiment, springs
from instrument.models.parameters import SensorParameters, get_parameters
from instrument.sample import Sample

# The models that each design has. The round sensor is the single one with discs for plates: reference case A.
ROUND = "single_round"
DESIGN_MODELS: dict[str, tuple[str, ...]] = {
    "single": ("column", "beam", "beam_printed", "experiment", "axisymmetric", "solid"),
    ROUND: ("column", "axisymmetric"),
    "common_base": ("column", "beam", "beam_printed", "experiment", "solid"),
}
CLOSED_FORMS: dict[str, Callable[[Design, Sample], float]] = {
    "column": springs.force_ratio,
    "beam": beam.force_ratio,
    "beam_printed": beam.printed_force_ratio,
    "experiment": experiment.force_ratio,
}
# What a caller may set in place of the parameter set's.
SETTINGS = (
    "compliant_modulus",
    "sensed_thickness",
    "sensed_poisson",
    "compliant_poisson",
    "plate_modulus",
    "interface",
)
# What a model holds fixed: the program has the plate's thickness for the object's, and an experiment was done once.
FIXED: dict[str, tuple[str, ...]] = {
    "beam_printed": ("sensed_thickness",),
    "experiment": tuple(name for name in SETTINGS if name != "sensed_thickness"),
}
# Where none is asked for: what takes about a second, and minutes without the extra "fast".
TOLERANCES = {"axisymmetric": 1e-4, "solid": 5e-3}


@dataclass(frozen=True, slots=True)
class Question:
    """Which sensor, by which model.

    Attributes:
        design: of DESIGN_MODELS.
        model: one that the design has.
        parameters: "thesis", "physical", or "identified", which is fitted to the finite-element models.
        settings: SETTINGS that override the parameter set, moduli in Pa and lengths in m.
        tolerance: greatest error estimate; None for the model's own of TOLERANCES.

    Raises:
        UnknownName: no such design, model of that design, parameter set of that model, or setting.
        RangeError: a setting that the model holds fixed, or a tolerance for a model without an error estimate.
    """

    design: str
    model: str
    parameters: str = "physical"
    settings: Mapping[str, float | str] = field(default_factory=dict)
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if self.design not in DESIGN_MODELS:
            raise UnknownName("design with a model of its force ratio", self.design, DESIGN_MODELS)
        if self.model not in DESIGN_MODELS[self.design]:
            raise UnknownName(f"model of design {self.design!r}", self.model, DESIGN_MODELS[self.design])
        get_parameters(self.parameters)
        if self.model in CLOSED_FORMS and self.parameters == "identified":
            raise UnknownName(f"parameter set of model {self.model!r}", self.parameters, ("thesis", "physical"))
        for name in self.settings:
            if name not in SETTINGS:
                raise UnknownName("setting of a model", name, SETTINGS)
            if name in FIXED.get(self.model, ()):
                raise RangeError(
                    f"{name} {self.settings[name]}: model {self.model!r} has its own and no other; leave it out"
                )
        if self.tolerance is not None and self.model not in TOLERANCES:
            raise RangeError(
                f"tolerance {self.tolerance:g}: model {self.model!r} has no error estimate to meet it;"
                f" leave it out, or ask one of {', '.join(TOLERANCES)}"
            )


@dataclass(frozen=True, slots=True)
class Answer:
    """One point.

    Attributes:
        sensed_modulus: of the object [Pa].
        force_ratio: tooth force over total force.
        error_estimate: bound on the error of `force_ratio`; None for models that have none.
        seconds: that it took.
    """

    sensed_modulus: float
    force_ratio: float
    error_estimate: float | None
    model: str
    seconds: float


def ask(question: Question, moduli: Sequence[float]) -> list[Answer]:
    """Force ratios at moduli of the sensed object [Pa]. Nothing is solved before everything is checked.

    Raises:
        RangeError: a modulus or setting is out of its limits, or the model cannot answer for it or to the tolerance.
        UnknownName: no such interface.
        EstimateError: a linear system cannot be solved accurately.
    """
    common = replace(get_parameters(question.parameters), **question.settings)  # type: ignore[arg-type]
    answers = []
    for parameters in [replace(common, sensed_modulus=modulus) for modulus in moduli]:
        start = time.perf_counter()
        ratio, estimate = _ratio(question, parameters)
        seconds = time.perf_counter() - start
        answers.append(Answer(parameters.sensed_modulus, ratio, estimate, question.model, seconds))
    return answers


def _ratio(question: Question, parameters: SensorParameters) -> tuple[float, float | None]:
    design = get_design("single" if question.design == ROUND else question.design)
    if question.model in CLOSED_FORMS:
        return CLOSED_FORMS[question.model](_with_materials(design, parameters), _sample(design, parameters)), None
    tolerance = TOLERANCES[question.model] if question.tolerance is None else question.tolerance
    if question.model == "axisymmetric":
        return axisymmetric.force_ratio(parameters, tolerance)
    return _solid(question, design, parameters, tolerance)


def _solid(question: Question, design: Design, parameters: SensorParameters, tolerance: float) -> tuple[float, float]:
    from instrument.models import solid

    if question.parameters == "identified":
        own, taken = solid.identified(design), tuple(question.settings)
    else:
        own, taken = solid.of_design(design), SETTINGS
    common = {name: getattr(parameters, name) for name in ("sensed_modulus", *taken)}
    return solid.force_ratio(replace(own, **common), tolerance)


def _with_materials(design: Design, parameters: SensorParameters) -> Design:
    ring, plate = design.ring, design.plate
    return replace(
        design,
        ring=replace(ring, material=replace(ring.material, modulus=parameters.compliant_modulus)),
        plate=replace(plate, material=replace(plate.material, modulus=parameters.plate_modulus)),
    )


def _sample(design: Design, parameters: SensorParameters) -> Sample:
    return Sample(
        name="sensed object",
        material="rubber",
        modulus=parameters.sensed_modulus,
        thickness=parameters.sensed_thickness,
        area=design.plate.length * design.plate.width,
        poisson=parameters.sensed_poisson,
        source="asked for",
    )
