"""Meshes of the solid model's sensors, from coarse to fine, and how errors fall from each to the next."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.instrument.errors import RangeError
from palpate.instrument.models.finite_elements.error_estimate import HALF_DECADE, Manner
from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.curve import Resolution

MANY = 4  # teeth; more have coarser meshes


@dataclass(frozen=True, slots=True)
class Meshes:
    """Resolutions by refinement, and how errors fall from each to the next."""

    resolutions: tuple[Resolution, ...]
    manner: Manner


# Each mesh has more layers and a higher degree than the one before. Most of their error is along the height of rubber,
# so the degree is higher there on the first two. Other parts of the third do with a lower one.
OF_FEW_TEETH = Meshes(
    resolutions=(
        Resolution(layers=2, ratio=0.15, sectors=1, degree=2, rubber=3),
        Resolution(layers=3, ratio=0.15, sectors=1, degree=3, rubber=4),
        Resolution(layers=4, ratio=0.15, sectors=1, degree=4, stiff=3),
    ),
    # The third mesh has the degree of the second along the height of rubber. Where that leaves most, both err alike:
    # then a share of the bound before counts.
    manner=Manner(product=0.05, factors=(1.5, 1.4), voltages=(8.0, 6.0), luck=0.06, reach=2 * HALF_DECADE),
)
# A higher degree, more layers, then both. Along the circle a higher degree costs less than more sectors. The third mesh
# has more layers alone, which are no use where the degree leaves most: then a share of the bound before counts.
OF_MANY_TEETH = Meshes(
    resolutions=(
        Resolution(layers=2, ratio=0.2, sectors=1, degree=2),
        Resolution(layers=2, ratio=0.2, sectors=1, degree=3),
        Resolution(layers=3, ratio=0.2, sectors=1, degree=3),
        Resolution(layers=4, ratio=0.2, sectors=1, degree=4),
    ),
    manner=Manner(product=0.15, factors=(2.0, 1.0, 0.5), voltages=(12.0, 8.0, 4.0), luck=0.12, reach=2 * HALF_DECADE),
)


def has_many_teeth(parameters: SolidParameters) -> bool:
    """Whether meshes are those of many teeth."""
    return parameters.columns * parameters.rows > MANY


def meshes(parameters: SolidParameters) -> Meshes:
    """The meshes of a sensor."""
    return OF_MANY_TEETH if has_many_teeth(parameters) else OF_FEW_TEETH


def refinements(parameters: SolidParameters) -> tuple[int, ...]:
    """Numbers of a sensor's meshes."""
    return tuple(range(len(meshes(parameters).resolutions)))


def resolution(parameters: SolidParameters, refinement: int) -> Resolution:
    """Resolution of a sensor's mesh of a refinement.

    Raises:
        RangeError: there is no such refinement.
    """
    known = refinements(parameters)
    if refinement not in known:
        raise RangeError(f"refinement {refinement} is outside {known[0]} to {known[-1]}; give one of these")
    return meshes(parameters).resolutions[refinement]
