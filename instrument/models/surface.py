"""Curves that come with palpate: what model "surface" answers from, without setting up a mesh.

    find(get_design("single"), load).force_ratios(np.array([24e3, 1e5]))

They are the curves of a finite-element model's first meshes over the modulus of the object, for the designs and the
sets of parameters in the folder `curves`. A file's name tells the design, the refinement and the start of its hash.
"""

from __future__ import annotations

import functools
import hashlib
import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.finite_elements.work import SUFFIX, read, write
from palpate.instrument.models.parameters import (
    CODE_VERSION,
    Parameters,
    RoundParameters,
    SolidParameters,
    fixed,
    round_parameters,
    solid_parameters,
)
from palpate.instrument.models.solid import ladders
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.solid.ladders import Resolution, SolidCurve
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Load

Solution = axisymmetric.Solution | solid.SolidSolution

# Shipped refinements: all up to one that is good to 1e-6, and in space all.
ROUND_REFINEMENTS = axisymmetric.REFINEMENTS[:4]
# Designs with many teeth have their first meshes alone; the last one takes minutes.
MOST_TEETH = 12
MANY_TEETH_REFINEMENTS, MOST_TEETH_REFINEMENTS = 3, 2
STORED = Path(__file__).with_name("curves")
# Parameter sets with shipped curves; the identified set has those of the designs that the thesis measured.
SETS = ("physical", "identified")
# Poles are left out that all together change goals and energies by no more than this share, far below the estimates.
NEGLIGIBLE = 1e-10
BESIDE = "beside"  # and a number, in place of a refinement: a mesh that the estimate asks beside these


@dataclass(frozen=True, slots=True)
class RoundMesh:
    """A shipped mesh of the axisymmetric model: its curve, and the processor time in which that was computed [s]."""

    curve: Curve
    seconds: float

    @property
    def poles(self) -> Curve:
        """The curve."""
        return self.curve


@dataclass(frozen=True, slots=True)
class SolidMesh:
    """A shipped mesh of the solid model: its curve, and the processor time in which that was computed [s]."""

    curve: SolidCurve
    seconds: float

    @property
    def poles(self) -> Curve:
        """The poles of the curve, without the numbers of teeth, bases and unknowns."""
        return self.curve.poles


@dataclass(frozen=True, slots=True)
class Surface:
    """The shipped curves of one sensor.

    Attributes:
        parameters: the sensor; neither the modulus of the object nor the force count.
        meshes: its meshes, each finer than the one before.
        beside: the meshes that the estimate of the last one asks (`solid.model.beside`); None: they are found.
    """

    parameters: Parameters
    meshes: tuple[RoundMesh, ...] | tuple[SolidMesh, ...]
    beside: tuple[SolidMesh, ...] | None = None

    @property
    def model(self) -> str:
        """Name of the finite-element model."""
        return model_of(self.parameters)

    @property
    def poles(self) -> Curve:
        """Poles of the finest mesh."""
        return self.meshes[-1].poles

    @property
    def seconds(self) -> float:
        """Processor time in which all meshes were found, with those beside [s]."""
        return math.fsum(mesh.seconds for mesh in (*self.meshes, *(self.beside or ())))

    def force_ratios(self, moduli: Floats) -> Floats:
        """Tooth force over total force at moduli of the object [Pa]."""
        return self.poles.force_ratios(moduli)[:, 0]

    def estimates(self, moduli: Floats) -> tuple[Floats, Floats]:
        """Bounds on the errors of force ratio and voltages under 1 N [V], at moduli of the object [Pa]."""
        curves = [mesh.poles for mesh in self.meshes]
        if isinstance(self.parameters, RoundParameters):
            return axisymmetric.estimates(curves, self.parameters, moduli)
        companions = None if self.beside is None else [mesh.poles for mesh in self.beside]
        return solid.estimates(curves, self.parameters, moduli, companions)

    def relative(self, moduli: Floats) -> Floats:
        """Bounds on the errors of force ratios, relative to these, at moduli of the object [Pa]."""
        found: Floats = self.estimates(moduli)[0] / self.force_ratios(moduli)
        return found

    def solve_at(self, moduli: Floats) -> list[tuple[Solution, float]]:
        """Solutions under 1 N and their error estimates, at moduli of the object [Pa]."""
        ratio, voltage = self.estimates(moduli)
        finest, found = self.meshes[-1], list[Solution]()
        if isinstance(finest, RoundMesh):
            found += axisymmetric.read(finest.curve, moduli, voltage)
        elif isinstance(self.parameters, SolidParameters):
            found += solid.read(finest.curve, self.parameters, moduli, voltage)
        return list(zip(found, ratio.tolist(), strict=True))


def curve_hash(parameters: Parameters, mesh: int | Resolution) -> str:
    """SHA-256 of all on which a shipped curve depends; mesh: its refinement, or its resolution if it has none."""
    text = f"curve {CODE_VERSION};{model_of(parameters)};refinement={mesh};{fixed(parameters)}"
    return hashlib.sha256(text.encode()).hexdigest()


def surface_parameters(design: Design, load: Load) -> Parameters:
    """Parameters of a design's surface: the axisymmetric model's for a round design, else the solid one's."""
    return (round_parameters if design.outline == "round" else solid_parameters)(design, load)


def find(design: Design, load: Load) -> Surface:
    """The shipped curves for a design and an object.

    Raises:
        RangeError: there are none for that design, object or load.
        ConfigError: a file is damaged, or one of the sensor's files is missing.
    """
    return read_surface(
        design, replace(load, force=1.0, sensed=replace(load.sensed, modulus=design.ring.material.modulus))
    )


@functools.lru_cache(maxsize=64)
def read_surface(design: Design, load: Load) -> Surface:
    """`find` with its results kept: a surface answers faster than its files are looked up."""
    parameters = surface_parameters(design, load)
    files = {refinement: (path, key) for refinement, path, key in places(design.name, parameters)}
    if not any(path.exists() for path, _ in files.values()):
        raise RangeError(
            f"model 'surface' has no surface for design {design.name!r} with these dimensions, materials and load; it"
            f" has {', '.join(sorted({path.name.split('.')[0] for path in STORED.glob(f'*{SUFFIX}')}))}, with the"
            " design's own values under a bonded object of 3 mm and Poisson ratio 0.3, and some with parameter set"
            f" 'identified'; ask model {model_of(parameters)!r}"
        )
    if isinstance(parameters, RoundParameters):
        return Surface(parameters, tuple(read(path, RoundMesh, key) for path, key in files.values()))
    found = tuple(read(path, SolidMesh, key) for path, key in files.values())
    count = len(refinements_of(parameters))
    return Surface(parameters, found[:count], found[count:])


def places(design: str, parameters: Parameters) -> Iterator[tuple[int | str, Path, str]]:
    """Refinements of a sensor's surface, and names of the meshes beside them, with their files and hashes."""
    keys: dict[int | str, str] = {each: curve_hash(parameters, each) for each in refinements_of(parameters)}
    keys |= {name: curve_hash(*asked) for name, asked in _beside(parameters).items()}
    for refinement, key in keys.items():
        yield refinement, STORED / f"{design}.{refinement}.{key[:8]}{SUFFIX}", key


def _beside(parameters: Parameters) -> dict[str, tuple[SolidParameters, Resolution]]:
    """Names of the meshes that the estimate asks beside those that are shipped, with their sensors and resolutions."""
    if isinstance(parameters, RoundParameters):
        return {}
    asked = solid.beside(parameters, len(refinements_of(parameters)))
    return {f"{BESIDE}{number}": each for number, each in enumerate(asked)}


def build(design: str, sensors: Iterable[Parameters]) -> Iterator[Path]:
    """Find the curves of a design with some sets of parameters, and write them in place of all that it has.

    Raises:
        EstimateError: a stiffness is not positive definite to working precision.
        OSError: a file cannot be written.
    """
    from palpate.instrument.models.axisymmetric import curves

    written = []
    for sensor in sensors:
        sensor = replace(sensor, sensed_modulus=1.0)
        asked = _beside(sensor)
        for refinement, path, key in places(design, sensor):
            start = time.process_time()
            mesh: RoundMesh | SolidMesh
            if isinstance(sensor, RoundParameters):
                found = curves.found_on(sensor, *axisymmetric.resolution_of(int(refinement)))
                mesh = RoundMesh(found.without(NEGLIGIBLE), time.process_time() - start)
            else:
                of, resolution = asked.get(str(refinement)) or (sensor, ladders.resolution(sensor, int(refinement)))
                solution = solid.found_on(of, resolution)
                mesh = SolidMesh(
                    replace(solution, poles=solution.poles.without(NEGLIGIBLE)), time.process_time() - start
                )
            write(path, mesh, key)
            written.append(path)
            yield path
    for old in set(STORED.glob(f"{design}.*{SUFFIX}")).difference(written):
        old.unlink()
    read_surface.cache_clear()


def model_of(parameters: Parameters) -> str:
    """Name of the finite-element model for these parameters."""
    return "axisymmetric" if isinstance(parameters, RoundParameters) else "solid"


def refinements_of(parameters: Parameters) -> tuple[int, ...]:
    """Refinements of the shipped meshes."""
    if isinstance(parameters, RoundParameters):
        return ROUND_REFINEMENTS
    whole = ladders.refinements(parameters)
    if parameters.columns * parameters.rows > MOST_TEETH:
        return whole[:MOST_TEETH_REFINEMENTS]
    return whole[:MANY_TEETH_REFINEMENTS] if ladders.has_many_teeth(parameters) else whole
