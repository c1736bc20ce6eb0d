"""Random sensors for the finite-element models, each number drawn on its own: moduli and lengths in the logarithm."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from palpate.instrument.models.parameters import RoundParameters, SensorParameters, SolidParameters
from palpate.instrument.models.solid import ladders
from palpate.instrument.models.solid.ladders import Resolution


def round_sensors(count: int, seed: int) -> list[RoundParameters]:
    """The object's edge anywhere from the ring to beyond it."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        shared = _sensor(rng)
        inner, outer = shared["ring_inner_radius"], shared["ring_outer_radius"]
        reach = inner + (outer - inner) * float(rng.uniform(0.3, 1.3))
        found.append(RoundParameters(**shared, sensed_radius=reach, plate_radius=outer))
    return found


def solid_sensors(discs: int, squares: int, pairs: int, seed: int) -> list[SolidParameters]:
    """Round sensors; square ones, some under a load in one point of the middle line; pairs on one or two bases."""
    rng = np.random.default_rng(seed)
    found = []
    for k in range(discs + squares + pairs):
        shared = _sensor(rng)
        wide = 2 * shared["ring_outer_radius"] * float(rng.uniform(1.0, 1.5))
        place = (float(rng.uniform(0, wide)), wide / 2) if rng.random() < 0.5 else None
        outline = str(rng.choice(["round", "square"]))
        cell = {"cell_length": wide, "cell_width": wide}
        if k < discs:
            found.append(SolidParameters(**shared, **cell, outline="round"))
        elif k < discs + squares:
            found.append(SolidParameters(**shared, **cell, ring_outline=outline, load_at=place))
        else:
            found.append(SolidParameters(**shared, **cell, ring_outline=outline, columns=2, separate_bases=k % 2 == 0))
    return found


def disc(sensor: SolidParameters) -> RoundParameters:
    """The same round sensor for the axisymmetric model."""
    shared = {field.name: getattr(sensor, field.name) for field in fields(SensorParameters)}
    outer = sensor.ring_outer_radius
    return RoundParameters(**shared, sensed_radius=outer, plate_radius=outer)


def _sensor(rng: np.random.Generator) -> dict[str, Any]:
    def between(low: float, high: float) -> float:
        return float(10 ** rng.uniform(np.log10(low), np.log10(high)))

    def one_of(*values: float) -> float:
        return float(rng.choice(values))

    tooth, gap, width = between(0.3e-3, 3e-3), between(1e-6, 1e-3), between(0.3e-3, 1e-2)
    return {
        "sensed_modulus": between(1.49e4, 140e9),
        "sensed_poisson": one_of(-0.2, 0.0, 0.3, 0.455, 0.49, 0.4999, 0.5),
        "sensed_thickness": between(1e-5, 1e-1),
        "compliant_modulus": between(1e4, 1e6),
        "compliant_poisson": one_of(0.0, 0.3, 0.455, 0.49, 0.4999, 0.5),
        "plate_modulus": between(7e7, 1e11),
        "interface": str(rng.choice(["bonded", "frictionless"])),
        "support": str(rng.choice(["elastic", "rigid"])),
        "tooth_radius": tooth,
        "ring_inner_radius": tooth + gap * one_of(0, 1, 1, 1),  # a gap may be closed
        "ring_outer_radius": tooth + gap + width,
        "sensor_height": between(1e-3, 1e-2),
    }


# --- meshes that are smaller than a model's own ------------------------------------------------------


def give_meshes(monkeypatch: pytest.MonkeyPatch, *resolutions: Resolution) -> None:
    """Let every sensor of the solid model have these meshes in place of its own."""
    for name in ("OF_FEW_TEETH", "OF_MANY_TEETH"):
        monkeypatch.setattr(ladders, name, replace(getattr(ladders, name), resolutions=resolutions))
