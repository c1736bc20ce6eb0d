"""Response surface: the axisymmetric model's force ratio as a polynomial in the logarithm of the modulus ratio.

R runs from the share of a soft object to that of a hard one, both finite, and is analytic in between, so
Chebyshev interpolation in log10 of the object's modulus over the ring's converges geometrically. The error
bound is measured at points between the nodes, where the polynomial never saw the model.
"""

from __future__ import annotations

import hashlib
import math
import zipfile
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from instrument.errors import ConfigError, EstimateError, RangeError
from instrument.models.parameters import RoundParameters

Array = NDArray[np.float64]
Ratios = TypeVar("Ratios", float, NDArray[np.float64])

LOWEST, HIGHEST = 0.1, 1e7
ERROR_LIMIT = 1e-6
# Raise it with every change of the model's numbers: surfaces of another version are refused.
CODE_VERSION = 1
REFINEMENT = 3
NODES = (25, 49, 97)  # each has the one before among its nodes


@dataclass(frozen=True, slots=True)
class ResponseSurface:
    """Force ratio over the modulus ratio, for one sensor and one object's thickness and Poisson ratio.

    Attributes:
        coefficients: of Chebyshev polynomials in log10 of the modulus ratio, -1 at `lowest`, 1 at `highest`.
        lowest, highest: modulus ratios between which it answers.
        error_bound: greatest relative difference from the finite-element model.
        design_hash: of parameters, refinement and code version.
    """

    coefficients: Array
    lowest: float
    highest: float
    error_bound: float
    design_hash: str

    def force_ratio(self, modulus_ratio: Ratios) -> Ratios:
        """Tooth force over total force, of the shape of `modulus_ratio`.

        Raises:
            RangeError: a modulus ratio lies outside the surface's, or is no number.
        """
        ratios = np.asarray(modulus_ratio, dtype=np.float64)
        bad = ~((ratios >= self.lowest) & (ratios <= self.highest))
        if bad.any():
            raise RangeError(
                f"modulus ratio {ratios[bad].flat[0]:g} is outside {self.lowest:g} to {self.highest:g} of the"
                " response surface; ask model 'axisymmetric'"
            )
        low, high = math.log10(self.lowest), math.log10(self.highest)
        place = (2 * np.log10(ratios) - (low + high)) / (high - low)
        value = np.polynomial.chebyshev.chebval(place, self.coefficients).astype(np.float64)
        return value if isinstance(modulus_ratio, np.ndarray) else float(value)

    def save(self, path: Path) -> None:
        """Write to an `.npz` file.

        Raises:
            OSError: the file cannot be written.
        """
        with path.open("wb") as file:
            np.savez(
                file,
                coefficients=self.coefficients,
                limits=np.array([self.lowest, self.highest, self.error_bound]),
                design_hash=np.array(self.design_hash),
                content_hash=np.array(self._content_hash()),
            )

    def _content_hash(self) -> str:
        digest = hashlib.sha256(self.design_hash.encode())
        digest.update(np.array([self.lowest, self.highest, self.error_bound], dtype="<f8").tobytes())
        digest.update(self.coefficients.astype("<f8").tobytes())
        return digest.hexdigest()


def design_hash(parameters: RoundParameters, refinement: int = REFINEMENT) -> str:
    """SHA-256 of what a surface depends on: everything but the object's modulus.

    The ring's modulus counts: it sets the sensor's own stiffness against the plates.
    """
    fixed = replace(parameters, sensed_modulus=parameters.compliant_modulus).canonical()
    return hashlib.sha256(f"surface {CODE_VERSION};refinement={refinement};{fixed}".encode()).hexdigest()


def build(parameters: RoundParameters, refinement: int = REFINEMENT) -> ResponseSurface:
    """Build the surface of a sensor over modulus ratios 0.1 to 1e7; `parameters.sensed_modulus` does not count.

    Raises:
        EstimateError: 97 nodes do not reach a relative error of 1e-6.
    """
    from instrument.models.axisymmetric import solve

    low, high = math.log10(LOWEST), math.log10(HIGHEST)
    known: dict[Fraction, float] = {}

    def at(angle: Fraction) -> float:
        if angle not in known:
            place = math.cos(math.pi * angle)
            modulus = parameters.compliant_modulus * 10 ** (low + (high - low) * (place + 1) / 2)
            known[angle] = solve(replace(parameters, sensed_modulus=modulus), refinement).force_ratio
        return known[angle]

    bound = math.inf
    for count in NODES:
        # Extreme points: the ends are met exactly, and every second one is a node of half the count.
        values = np.array([at(Fraction(index, count - 1)) for index in range(count)])
        coefficients = _interpolate(values)
        between = [Fraction(2 * index + 1, 2 * (count - 1)) for index in range(0, count - 1, 2)]
        truth = np.array([at(angle) for angle in between])
        places = np.cos(math.pi * np.array(between, dtype=np.float64))
        error = np.abs(np.polynomial.chebyshev.chebval(places, coefficients) / truth - 1)
        # Twice the worst of those looked at stands for those in between.
        bound = 2 * float(error.max()) + 1e-12
        if bound < ERROR_LIMIT:
            return ResponseSurface(coefficients, LOWEST, HIGHEST, bound, design_hash(parameters, refinement))
    raise EstimateError(
        f"response surface: relative error {bound:.1e} at {NODES[-1]} nodes is above {ERROR_LIMIT:g};"
        " ask model 'axisymmetric' itself"
    )


def load(path: Path, parameters: RoundParameters, refinement: int = REFINEMENT) -> ResponseSurface:
    """Read the surface of that sensor.

    Raises:
        ConfigError: no such file, it is corrupt, or it belongs to another design or code version.
    """
    try:
        # np.load leaves a file that it opened itself open when it turns out to be cut off.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            lowest, highest, bound = (float(value) for value in stored["limits"])
            surface = ResponseSurface(
                coefficients=np.asarray(stored["coefficients"], dtype=np.float64),
                lowest=lowest,
                highest=highest,
                error_bound=bound,
                design_hash=str(stored["design_hash"]),
            )
            content = str(stored["content_hash"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ConfigError(f"response surface {path}: not readable ({error}); build it again") from error
    if content != surface._content_hash():
        raise ConfigError(f"response surface {path}: content hash does not fit its content; build it again")
    expected = design_hash(parameters, refinement)
    if surface.design_hash != expected:
        raise ConfigError(
            f"response surface {path}: belongs to another design or version ({surface.design_hash[:12]}, not"
            f" {expected[:12]}); build it for this one"
        )
    return surface


def _interpolate(values: Array) -> Array:
    """Chebyshev coefficients of the polynomial through `values` at cos(π k / n), k = 0 to n."""
    from scipy.fft import dct

    count = len(values) - 1
    coefficients: Array = dct(values, type=1) / count
    coefficients[[0, -1]] /= 2
    return coefficients
