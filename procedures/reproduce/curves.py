"""Force ratio against the object's modulus, from a few finite-element solutions.

The logarithm of the odds, tooth force over ring force, is nearly a straight line in the logarithm of the modulus
and bends only at its ends. Its Chebyshev interpolant through 15 solutions is within 2e-4 of the force ratio. The solid
model takes them on its coarsest mesh, and a parabola through three adds what the next finer mesh changes: together
within 5e-4 of that mesh, which is within 1e-3 of the converged ratio.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

from palpate.instrument.errors import ConfigError
from palpate.instrument.models.film import film_response
from palpate.instrument.models.parameters import (
    CODE_VERSION,
    ParameterSet,
    RoundParameters,
    SolidParameters,
    get_parameter_set,
    round_parameters,
    solid_parameters,
)
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.thesis import ThesisTable
from palpate.procedures.console.terminal import Progress
from palpate.procedures.records.run import storing

# --- Kept finite-element solutions for reproducing the thesis: they take more than a minute and are always the same
#
# Each is kept under a hash of every number on which it depends and of the version of the models' code. So a changed
# design or model does not find it and is solved anew. `palpate reproduce models --fresh` solves everything and writes
# the content of `solutions.json`.

SHIPPED = Path(__file__).with_name("solutions.json")
DIGITS = 10  # of a modulus: nodes differ by rounding from machine to machine


@dataclass(slots=True)
class Solutions:
    """Known solutions, and the solutions that were asked for so far."""

    kept: dict[str, list[float]] = field(default_factory=dict)
    asked: dict[str, list[float]] = field(default_factory=dict)

    @classmethod
    def shipped(cls, file: Path = SHIPPED) -> Self:
        """Solutions that come with palpate. Raises ConfigError: the file is damaged."""
        try:
            ratios = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
            if all(isinstance(number, float) for numbers in ratios.values() for number in numbers):
                return cls(ratios)
        except (OSError, ValueError, AttributeError, TypeError, RecursionError):
            pass
        raise ConfigError(f"{file}: is damaged; solve anew: palpate reproduce models --fresh")

    def of(
        self,
        parameters: RoundParameters | SolidParameters,
        what: str,
        solve: Callable[[], Sequence[float]],
    ) -> list[float]:
        """Kept numbers for these parameters, else the result of `solve`; `what` names mesh and quantity."""
        modulus = float(f"{parameters.sensed_modulus:.{DIGITS}g}")
        rounded = replace(parameters, sensed_modulus=modulus).canonical()
        text = f"{CODE_VERSION};{type(parameters).__name__};{what};{rounded}"
        key = hashlib.sha256(text.encode()).hexdigest()[:32]
        self.asked[key] = self.kept[key] if key in self.kept else list(solve())
        return self.asked[key]

    def write(self, folder: Path) -> Path:
        """Write all solutions that were asked for, as a file to ship. Raises RecordError."""
        path = folder / SHIPPED.name
        with storing(path):
            path.write_text(self.text(), encoding="utf-8")
        return path

    def text(self) -> str:
        """Text of the file with all solutions that were asked for."""
        return json.dumps(self.asked, indent=0, sort_keys=True) + "\n"


# --- the curves ----------------------------------------------------------------------------------------

Array = NDArray[np.float64]

# The thesis' two rings, 3.1.4.
RINGS = RING, STIFF_RING = 24e3, 33e3
# Moduli of the object over the ring's, around the 14.9 kPa to 140 GPa of Table A2.1 on both.
LOWEST, HIGHEST = 0.4, 6e6
NODES, LIKE_NODES, FINE_NODES = 15, 5, 3  # three and five are among the fifteen
ROUND_MESH, COARSE_MESH, FINE_MESH = 2, 0, 1
TOOTH, BASE = "tooth", "base"
Solved = tuple[float, float, float, float, float]
QUANTITIES = 5


def ring_of(table: ThesisTable) -> float:
    """Young modulus of the ring in a table of finite elements [Pa]."""
    return float(table.values("compliant_modulus_Pa")[0])


@dataclass(frozen=True, slots=True)
class CurveCase:
    """Case of one curve: sensor, finite-element model, parameter set, and modulus of the ring [Pa]."""

    design: str
    model: str
    parameters: str
    ring: float = RING

    @property
    def parameter_set(self) -> ParameterSet:
        return get_parameter_set(self.parameters, self.model)

    def sensor(self) -> Design:
        """The design with its parameter set and ring."""
        design = self.parameter_set.design(get_design(self.design))
        material = replace(design.ring.material, modulus=self.ring)
        return replace(design, ring=replace(design.ring, material=material))

    def parameters_at(self, modulus: float) -> RoundParameters | SolidParameters:
        """Parameters of the model at a modulus of the object [Pa]."""
        sensor, load = self.sensor(), self.parameter_set.load(modulus)
        return (round_parameters if self.model == "axisymmetric" else solid_parameters)(sensor, load)

    @property
    def like(self) -> CurveCase | None:
        """A case with nearly the same curve over the ratio of moduli: the softer ring's, or the common base's."""
        if self.ring != RING:
            return replace(self, ring=RING)
        if self.design == "different_base":
            return replace(self, design="common_base")
        return None

    @property
    def as_like(self) -> bool:
        """Whether the curve equals that of `like`: on a rigid support base and modulus of the ring have no effect."""
        return self.like is not None and self.sensor().support == "rigid"


@dataclass(frozen=True, slots=True)
class SensorCurve:
    """Curves of a sensor under 1 N.

    Attributes:
        sensor: the design.
        log_odds: logarithm of tooth force over the rest, against the logarithm of the object's modulus over the ring's.
        stresses: mean stresses along axes 1 and 2 of the film "tooth" or "base" [Pa], against the same.
    """

    sensor: Design
    log_odds: Chebyshev
    stresses: Mapping[str, tuple[Chebyshev, Chebyshev]]

    def force_ratio(self, moduli: Array) -> Array:
        """Tooth force over total force for moduli of the object [Pa]."""
        ratio: Array = 1 / (1 + np.exp(-self.log_odds(self._place(moduli))))
        return ratio

    def voltage(self, film: str, moduli: Array) -> Array:
        """Open-circuit voltage of the film under one of the teeth, or under the base of all [V]."""
        place = self._place(moduli)
        force = self.force_ratio(moduli) / len(self.sensor.teeth) if film == TOOTH else np.ones(len(moduli))
        along, across = (stress(place) for stress in self.stresses[film])
        return film_voltages(self.sensor, film, force, along, across)

    def _place(self, moduli: Array) -> Array:
        place: Array = np.log(moduli / self.sensor.ring.material.modulus)
        return place


def film_voltages(sensor: Design, film: str, forces: Array, along: Array, across: Array) -> Array:
    """Voltages [V] of an open film under forces [N] and stresses in its plane [Pa]."""
    kind = "rigid" if film == TOOTH else "total"
    area = sensor.film_area(next(f for f in sensor.films if f.kind == kind))
    material, thickness = sensor.film_sheet.material, sensor.film_sheet.thickness
    return np.array(
        [
            film_response(material, area, thickness, force, "free", "open", (first, second)).voltage
            for force, first, second in zip(forces, along, across, strict=True)
        ]
    )


class Curves:
    """Curves by case. Each is made once, and finite-element solutions are counted for the progress.

    Args:
        wanted: all cases that will be asked for.
        extra: number of solutions that `step` counts beside those of the curves.
        solutions: known solutions; None: there are none.
    """

    def __init__(
        self,
        wanted: Iterable[CurveCase],
        extra: int = 0,
        progress: Progress = lambda *_: None,
        solutions: Solutions | None = None,
    ) -> None:
        self.solutions = Solutions() if solutions is None else solutions
        self._curves: dict[CurveCase, SensorCurve] = {}
        self._solved: dict[tuple[CurveCase, float, int], Solved] = {}
        self._progress = progress
        self._done, self._total = 0, extra + sum(_cost(case) for case in dict.fromkeys(wanted))

    def step(self, what: str) -> None:
        """One more solution is done."""
        self._done += 1
        self._progress(self._done, self._total, what)

    def of(self, case: CurveCase) -> SensorCurve:
        """The curve of a case.

        Raises:
            EstimateError: a linear system cannot be solved accurately.
        """
        if case not in self._curves:
            self._curves[case] = self._make(case)
        return self._curves[case]

    def _make(self, case: CurveCase) -> SensorCurve:
        mesh = ROUND_MESH if case.model == "axisymmetric" else COARSE_MESH
        if case.like is not None:
            curve = replace(self.of(case.like), sensor=case.sensor())
            if case.as_like:
                return curve
            change = self._interpolate(case, mesh, LIKE_NODES, less=(case.like, mesh))
            return replace(curve, log_odds=curve.log_odds + change)
        log_odds, *stresses = (self._interpolate(case, mesh, NODES, quantity) for quantity in range(QUANTITIES))
        if case.model == "solid":
            log_odds += self._interpolate(case, FINE_MESH, FINE_NODES, less=(case, COARSE_MESH))
        return SensorCurve(
            case.sensor(), log_odds, {TOOTH: (stresses[0], stresses[1]), BASE: (stresses[2], stresses[3])}
        )

    def _interpolate(
        self, case: CurveCase, mesh: int, nodes: int, quantity: int = 0, less: tuple[CurveCase, int] | None = None
    ) -> Chebyshev:
        """Interpolant of a case's quantity over log(modulus ratio), less that of another case where one is given."""

        def sampled(places: Array) -> Array:
            values = np.array([self._solve(case, place, mesh)[quantity] for place in places])
            return values if less is None else values - [self._solve(less[0], p, less[1])[quantity] for p in places]

        return Chebyshev.interpolate(sampled, nodes - 1, domain=[math.log(LOWEST), math.log(HIGHEST)])

    def _solve(self, case: CurveCase, place: float, mesh: int) -> Solved:
        """The result of `solve` at a logarithm of the modulus ratio."""
        key = (case, round(place, 9), mesh)  # nodes of two interpolants differ by rounding only
        if key not in self._solved:
            modulus = case.ring * math.exp(place)
            solved = self.solutions.of(case.parameters_at(modulus), f"mesh {mesh}", lambda: solve(case, modulus, mesh))
            self._solved[key] = solved[0], solved[1], solved[2], solved[3], solved[4]
            self.step(f"{case.design} by {case.model}, {case.parameters}")
        return self._solved[key]


def solve(case: CurveCase, modulus: float, mesh: int) -> Solved:
    """Logarithm of the odds, tooth force over the rest, and mean stresses of films [Pa], under 1 N.

    The stresses are those of the first tooth's film and then of the base's, along their axes 1 and 2. They are zero on
    a rigid support.

    Raises:
        EstimateError: the linear system cannot be solved accurately.
    """
    from palpate.instrument.models.axisymmetric import model as axisymmetric
    from palpate.instrument.models.solid import model as solid

    parameters = case.parameters_at(modulus)
    tooth = base = (0.0, 0.0)
    ratio: float
    if isinstance(parameters, RoundParameters):
        disc = axisymmetric.solve(parameters, mesh)
        ratio = disc.force_ratio
        if disc.films:
            tooth, base = ((disc.films[film].plane_stress,) * 2 for film in (TOOTH, BASE))
    else:
        square = solid.solve(parameters, mesh)
        ratio = square.force_ratio
        if square.tooth_films:
            tooth, base = square.tooth_films[0], square.base_films[0]
    return (math.log(ratio / (1 - ratio)), *tooth, *base)


def _cost(case: CurveCase) -> int:
    """Number of finite-element solutions for a curve, once the curve of `like` is known."""
    if case.like is not None:
        return 0 if case.as_like else LIKE_NODES
    return NODES + (FINE_NODES if case.model == "solid" else 0)
