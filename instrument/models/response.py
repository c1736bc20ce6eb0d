"""One question, whatever the model: what force does the tooth take?

    load = Load(force=3.0, sensed=get_sample("2"))
    response(get_design("single"), load, model="column").force_ratio

Every model here is linear in the force.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from instrument.design import Design
from instrument.errors import RangeError, UnknownName
from instrument.models import beam, experiment, springs
from instrument.sample import Sample


@dataclass(frozen=True, slots=True)
class Load:
    """A force on the sensor [N], peak to peak, through a sensed object.

    Raises:
        RangeError: the force is not positive and finite.
    """

    force: float
    sensed: Sample

    def __post_init__(self) -> None:
        if not (0 < self.force < math.inf):
            raise RangeError(f"load {self.force:g} N is not above 0 and finite; give a positive force")


@dataclass(frozen=True, slots=True)
class Response:
    """What the sensor does under a load.

    Attributes:
        force_rigid: force on the tooth [N].
        force_total: force on the base [N].
        force_ratio: force_rigid / force_total.
        stiffness: of the stack of object and sensor [N/m], by the column model whichever model divides
            the force: the others have no deflection of their own that could be measured.
    """

    force_rigid: float
    force_total: float
    force_ratio: float
    stiffness: float


Model = Callable[[Design, Load], Response]


def _by_ratio(force_ratio: Callable[[Design, Sample], float]) -> Model:
    def model(design: Design, load: Load) -> Response:
        ratio = force_ratio(design, load.sensed)
        return Response(
            force_rigid=ratio * load.force,
            force_total=load.force,
            force_ratio=ratio,
            stiffness=springs.stiffness(design, load.sensed),
        )

    return model


MODELS: dict[str, Model] = {
    "column": _by_ratio(springs.force_ratio),
    "beam_printed": _by_ratio(beam.printed_force_ratio),
    "beam": _by_ratio(beam.force_ratio),
    "experiment": _by_ratio(experiment.force_ratio),
}


def response(design: Design, load: Load, model: str = "experiment") -> Response:
    """Forces on tooth and base.

    Raises:
        UnknownName: no such model.
        RangeError: the model does not answer for this object.
    """
    try:
        chosen = MODELS[model]
    except KeyError:
        raise UnknownName("model", model, MODELS) from None
    return chosen(design, load)
