"""Response surface: a finite-element model's force ratio as a polynomial in the logarithm of the modulus ratio.

    find(get_design("single"), load).force_ratio(load.sensed.modulus / 24e3)

The force ratio runs from that of a very soft object to that of a very hard one and is analytic in between. So Chebyshev
interpolation in log10 of the object's modulus over the ring's converges geometrically. The error bound is measured at
points between the nodes, which the polynomial was not fitted to.
"""

from __future__ import annotations

import functools
import hashlib
import math
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import ConfigError, RangeError
from palpate.instrument.models.parameters import RoundParameters, SolidParameters, round_parameters, solid_parameters
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.load import Load

Array = NDArray[np.float64]
Ratios = TypeVar("Ratios", float, NDArray[np.float64])
Parameters = RoundParameters | SolidParameters

LOWEST, HIGHEST = 0.1, 1e7
# Raise this with every change of the models' numbers: surfaces of another version are refused.
CODE_VERSION = 3
REFINEMENTS = {"axisymmetric": 3, "solid": 1}  # of the stored surfaces
# Designs with more teeth use the solid model's coarsest mesh; the next one takes a minute for each modulus.
FEW_TEETH = 4
STORED = Path(__file__).with_name("surfaces")
# Parameter sets with stored surfaces; the identified set has those of the designs that the thesis measured.
SETS = ("physical", "identified")
LARGEST_SURFACE = 1_000_000  # greatest number of bytes when unpacked; 97 nodes take a few thousand


@dataclass(frozen=True, slots=True)
class ResponseSurface:
    """Force ratio over the modulus ratio, for one sensor and one object's thickness and Poisson ratio.

    Attributes:
        coefficients: coefficients of Chebyshev polynomials in log10 of the modulus ratio, -1 at `lowest`, 1 at
            `highest`.
        lowest, highest: least and greatest modulus ratio of the surface.
        error_bound: greatest relative difference from the finite-element model.
        discretisation: bound on the error of the finite-element model's force ratio.
        seconds: wall time that building took [s].
        model: name of the finite-element model.
        design_hash: hash of parameters, refinement and code version.
    """

    coefficients: Array
    lowest: float
    highest: float
    error_bound: float
    discretisation: float
    seconds: float
    model: str
    design_hash: str

    def force_ratio(self, modulus_ratio: Ratios) -> Ratios:
        """Tooth force over total force, of the shape of `modulus_ratio`.

        Raises:
            RangeError: a modulus ratio lies outside the surface, or is no number.
        """
        ratios = np.asarray(modulus_ratio, dtype=np.float64)
        bad = ~((ratios >= self.lowest) & (ratios <= self.highest))
        if bad.any():
            raise RangeError(
                f"modulus ratio {ratios[bad].flat[0]:g} is outside {self.lowest:g} to {self.highest:g} of the"
                f" response surface; ask model {self.model!r}"
            )
        low, high = math.log10(self.lowest), math.log10(self.highest)
        place = (2 * np.log10(ratios) - (low + high)) / (high - low)
        value = np.polynomial.chebyshev.chebval(place, self.coefficients).astype(np.float64)
        return value if isinstance(modulus_ratio, np.ndarray) else float(value)

    def thinned(self, stride: int) -> ResponseSurface:
        """The surface through every `stride`-th node; its error bound is not known."""
        count = len(self.coefficients)
        kept = np.cos(math.pi * np.arange(0, count, stride) / (count - 1))
        coefficients = interpolate(np.polynomial.chebyshev.chebval(kept, self.coefficients).astype(np.float64))
        return replace(self, coefficients=coefficients, error_bound=math.inf)

    def save(self, path: Path) -> None:
        """Write to an `.npz` file.

        Raises:
            OSError: the file cannot be written.
        """
        with path.open("wb") as file:
            np.savez(
                file,
                coefficients=self.coefficients,
                numbers=self._numbers(),
                model=np.array(self.model),
                design_hash=np.array(self.design_hash),
                content_hash=np.array(self._content_hash()),
            )

    def _numbers(self) -> Array:
        return np.array([self.lowest, self.highest, self.error_bound, self.discretisation, self.seconds])

    def _content_hash(self) -> str:
        digest = hashlib.sha256(f"{self.model};{self.design_hash}".encode())
        digest.update(self._numbers().astype("<f8").tobytes())
        digest.update(self.coefficients.astype("<f8").tobytes())
        return digest.hexdigest()


def fixed(parameters: Parameters) -> str:
    """Text of everything on which a force ratio depends, except the object's modulus.

    The ring's modulus is in it, because it sets the sensor's stiffness against that of the plates.
    """
    apart = replace(parameters, sensed_modulus=parameters.compliant_modulus)
    if isinstance(apart, SolidParameters):
        apart = replace(apart, force=1.0)
    return apart.canonical()


def design_hash(parameters: Parameters, refinement: int | None = None) -> str:
    """SHA-256 of everything on which a surface depends; None: with the refinement of the stored surfaces."""
    model = model_of(parameters)
    used = refinement_of(parameters) if refinement is None else refinement
    text = f"surface {CODE_VERSION};{model};refinement={used};{fixed(parameters)}"
    return hashlib.sha256(text.encode()).hexdigest()


def stored_at(design: str, parameters: str) -> Path:
    """The file of a design's surface with a parameter set."""
    return STORED / (f"{design}.npz" if parameters == SETS[0] else f"{design}.{parameters}.npz")


def surface_parameters(design: Design, load: Load) -> Parameters:
    """Parameters of a design's surface: the axisymmetric model's for a round design, else the solid one's."""
    return (round_parameters if design.outline == "round" else solid_parameters)(design, load)


def read(path: Path) -> ResponseSurface:
    """Read a file that `ResponseSurface.save` wrote.

    Raises:
        ConfigError: there is no such file, or it is corrupt.
    """
    try:
        # np.load would leave a file open that it opened itself and found to be cut off.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            _hold_limits(stored.zip)
            lowest, highest, bound, discretisation, seconds = (float(value) for value in stored["numbers"])
            surface = ResponseSurface(
                coefficients=np.asarray(stored["coefficients"], dtype=np.float64),
                lowest=lowest,
                highest=highest,
                error_bound=bound,
                discretisation=discretisation,
                seconds=seconds,
                model=str(stored["model"]),
                design_hash=str(stored["design_hash"]),
            )
            content = str(stored["content_hash"])
    except Exception as error:  # zipfile and numpy raise many kinds of errors for a damaged file
        raise ConfigError(f"response surface {path}: not readable ({error}); build it again") from error
    if content != surface._content_hash():
        raise ConfigError(f"response surface {path}: content hash does not fit its content; build it again")
    return surface


def _hold_limits(archive: zipfile.ZipFile) -> None:
    """Check that an unpacked file is not larger than a surface can be. Raises ValueError."""
    size = sum(entry.file_size for entry in archive.infolist())
    if size > LARGEST_SURFACE:
        raise ValueError(f"{size} bytes unpacked, {LARGEST_SURFACE} are the most")


def find(design: Design, load: Load) -> ResponseSurface:
    """The stored surface for a design and an object.

    Raises:
        RangeError: there is none for that design, object or load.
        ConfigError: its file is corrupt.
    """
    return _find(design, replace(load, force=1.0, sensed=replace(load.sensed, modulus=design.ring.material.modulus)))


@functools.lru_cache(maxsize=64)
def _find(design: Design, load: Load) -> ResponseSurface:
    """`find` with its results kept: a surface answers faster than its file is looked up."""
    parameters = surface_parameters(design, load)
    wanted = design_hash(parameters)
    for path in sorted(STORED.glob(f"{design.name}.*npz")):
        surface = read(path)
        if surface.design_hash == wanted:
            return surface
    shipped = ", ".join(sorted(file.stem.replace(".", " by set ") for file in STORED.glob("*.npz")))
    raise RangeError(
        f"model 'surface' has no surface for design {design.name!r} with these dimensions, materials and load; it has"
        f" {shipped}, and without a set only for the design's own values under a bonded object of 3 mm and Poisson"
        f" ratio 0.3; ask model {model_of(parameters)!r}"
    )


def interpolate(values: Array) -> Array:
    """Chebyshev coefficients of the polynomial through `values` at cos(π k / n), k = 0 to n."""
    from scipy.fft import dct

    count = len(values) - 1
    coefficients: Array = dct(values, type=1) / count
    coefficients[[0, -1]] /= 2
    return coefficients


def model_of(parameters: Parameters) -> str:
    """Name of the finite-element model for these parameters."""
    return "axisymmetric" if isinstance(parameters, RoundParameters) else "solid"


def refinement_of(parameters: Parameters) -> int:
    """Refinement of the stored surface."""
    return 0 if has_many_teeth(parameters) else REFINEMENTS[model_of(parameters)]


def has_many_teeth(parameters: Parameters) -> bool:
    """Whether there are more than FEW_TEETH teeth."""
    return isinstance(parameters, SolidParameters) and parameters.columns * parameters.rows > FEW_TEETH
