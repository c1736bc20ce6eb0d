"""How much each possible cause changes the solid model's force ratio, on one sensor and on a pair, one at a time.

Each is solved on the solid model's coarsest mesh, within 1 % of the converged ratio, where only the change counts, and
kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from palpate.instrument.models.parameter_sets import PHYSICAL
from palpate.instrument.models.parameters import SolidParameters, solid_parameters
from palpate.instrument.models.validation import Validation
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.film_material import FilmMaterial
from palpate.instrument.sensor.sample import SAMPLES, Sample
from palpate.procedures.console.progress import Progress
from palpate.procedures.reproduce.solutions import Solutions

STORED = Path(__file__).with_name("what_if.json")
SECONDS = 11.0  # s of processor time that these and the models of `accuracy validation` take [M]
ONE, PAIR = "single", "common_base"
MESH = 0
SOFT_FILM = FilmMaterial.isotropic(22e6, 0.34)

Changed = Callable[[SolidParameters], SolidParameters]


@dataclass(frozen=True, slots=True)
class WhatIf:
    """One cause, as what it changes in the physical set's numbers."""

    name: str
    cause: str
    changed: Changed


def _put(**numbers: Any) -> Changed:
    return lambda given: replace(given, **numbers)


def _scaled(object_times: float, ring_times: float, **numbers: Any) -> Changed:
    return lambda given: replace(
        given,
        sensed_modulus=given.sensed_modulus * object_times,
        compliant_modulus=given.compliant_modulus * ring_times,
        **numbers,
    )


def _squeezed(cell: float) -> Changed:
    return _put(cell_length=cell, cell_width=cell)


def _in_the_middle(given: SolidParameters) -> SolidParameters:
    return replace(given, load_at=(given.length / 2, given.width / 2))


WHAT_IFS = (
    WhatIf("as the thesis describes it", "-", _put()),
    WhatIf("object slides on tooth and ring", "friction, slip", _put(interface="frictionless")),
    WhatIf("rigid flat probe, not a uniform pressure", "load's distribution", _put(load="platen")),
    WhatIf("force in one point, in the middle", "load's distribution", _in_the_middle),
    WhatIf("object and plates end with the rings, cell of 10 mm", "object's geometry", _squeezed(10e-3)),
    WhatIf("object and plates reach past the rings, cell of 12 mm", "object's geometry", _squeezed(12e-3)),
    WhatIf("rings fill their cells", "object's support", _put(ring_outline="square")),
    WhatIf("object of 2 mm", "object's geometry", _put(sensed_thickness=2e-3)),
    WhatIf("object of 4 mm", "object's geometry", _put(sensed_thickness=4e-3)),
    WhatIf("Poisson ratio of the object 0.49", "rubber", _put(sensed_poisson=0.49)),
    WhatIf("Poisson ratio of the object 0.05", "rubber", _put(sensed_poisson=0.05)),
    WhatIf("Poisson ratio of the ring 0.4999", "rubber", _put(compliant_poisson=0.4999)),
    WhatIf("Poisson ratio of the ring 0.3", "rubber", _put(compliant_poisson=0.3)),
    WhatIf("ring twice as stiff, objects as they are", "rubber that stiffens", _scaled(1.0, 2.0)),
    WhatIf("objects 0.6 times as stiff", "moduli of the samples", _scaled(0.6, 1.0)),
    WhatIf("all rubber 9.5 times as stiff", "calibration of the load cell", _scaled(9.5, 9.5)),
    WhatIf("plates of 3 GPa", "base", _put(plate_modulus=3e9)),
    WhatIf("tooth, films and plates rigid", "base, film's yielding", _put(support="rigid")),
    WhatIf("films 100 times as soft", "film's yielding", _put(film=SOFT_FILM)),
    WhatIf("rigid flat probe, object slides", "two together", _put(load="platen", interface="frictionless")),
    WhatIf("rigid flat probe, ring three times as stiff", "two together", _scaled(1.0, 3.0, load="platen")),
)


@dataclass(frozen=True, slots=True)
class Effect:
    """The effect of a cause on both arrangements.

    Attributes:
        what_if: the cause.
        by_design: difference from the experiments with the cause, by design.
        contrasts: the pair's force ratio over the single sensor's, by sample.
    """

    what_if: WhatIf
    by_design: dict[str, Validation]
    contrasts: dict[str, float]

    @property
    def contrast(self) -> float:
        """Mean of the contrasts."""
        return mean_of(self.contrasts)

    def record(self) -> dict[str, Any]:
        """Under public names."""
        return {
            "name": self.what_if.name,
            "cause": self.what_if.cause,
            "designs": {name: found.record() for name, found in self.by_design.items()},
            "pair_over_single": self.contrasts,
        }


def effects(solutions: Solutions, progress: Progress) -> list[Effect]:
    """Every cause. Raises EstimateError: a linear system cannot be solved accurately."""
    found = []
    for done, what_if in enumerate(WHAT_IFS):
        progress(done, len(WHAT_IFS), what_if.name)
        ratios = {design: _ratios(solutions, design, what_if) for design in (ONE, PAIR)}
        by_design = {design: _compared(design, ratios[design]) for design in ratios}
        found.append(Effect(what_if, by_design, _contrasts(ratios[PAIR], ratios[ONE])))
    return found


def measured_contrasts() -> dict[str, float]:
    """The pair's measured force ratio over the single sensor's, by sample."""
    return _contrasts(get_design(PAIR).thesis_force_ratio, get_design(ONE).thesis_force_ratio)


def mean_of(by_sample: Mapping[str, float]) -> float:
    """Mean over the samples."""
    return math.fsum(by_sample.values()) / len(by_sample)


def _contrasts(pair: Mapping[str, float], one: Mapping[str, float]) -> dict[str, float]:
    return {name: pair[name] / one[name] for name in SAMPLES}


def _compared(design: str, ratios: dict[str, float]) -> Validation:
    measured = get_design(design).thesis_force_ratio
    percent = {name: 100 * (ratios[name] / ratio - 1) for name, ratio in measured.items()}
    return Validation(design, "physical", "solid", "compared", percent=percent)


def asked(design: str, what_if: WhatIf, sample: Sample) -> SolidParameters:
    """The parameters of the solid model with a cause, for a sample."""
    return what_if.changed(solid_parameters(get_design(design), PHYSICAL.load(sample.modulus)))


def _ratios(solutions: Solutions, design: str, what_if: WhatIf) -> dict[str, float]:
    """Force ratio of each sample."""
    found = {}
    for name, sample in SAMPLES.items():
        parameters = asked(design, what_if, sample)
        (found[name],) = solutions.of(parameters, f"what if, mesh {MESH}", partial(_solve, parameters))
    return found


def _solve(parameters: SolidParameters) -> list[float]:
    from palpate.instrument.models.solid import model as solid

    return [solid.solve(parameters, MESH).force_ratio]
