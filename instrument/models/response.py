"""The one call for all models: force on the teeth and signals of the films under a load.

    load = Load(force=3.0, sensed=get_sample("2"))
    response(get_design("single"), load, model="axisymmetric", tolerance=1e-4).force_ratio

Every model here is linear in the force.
"""

from __future__ import annotations

from collections.abc import Sequence

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models.table import MODELS, Response
from palpate.instrument.quantity import check_tolerance
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.load import Load

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
