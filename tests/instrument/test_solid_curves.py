"""Curves of the solid model over the modulus of the object, beside solutions for one modulus at a time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.models.solid.model import curve_on, solve_on
from tests.instrument.direct import direct

SMALL = Resolution(layers=1, ratio=0.2, sectors=1, degree=2)
UNLIKE = Resolution(layers=1, ratio=0.2, sectors=1, degree=3, rubber=4, stiff=2)  # degrees of elements differ
RIGID: dict[str, Any] = {"support": "rigid"}
RATIOS = (1e-2, 4.0, 1e8)  # moduli of the object over the ring's
PAIR: dict[str, Any] = {"cell_length": 12e-3, "cell_width": 12e-3, "columns": 2}
SENSORS: dict[str, tuple[dict[str, Any], float]] = {
    "bonded": ({}, 1e-10),
    "unlike degrees": ({}, 1e-10),
    "rigid, bonded": (RIGID, 1e-10),
    "rigid, capped": ({**RIGID, "interface": "capped"}, 1e-10),
    "rigid, closed gap": ({**RIGID, "ring_inner_radius": 1.4e-3}, 1e-10),
    "platen": ({"load": "platen"}, 1e-10),
    "pair": ({**PAIR, **RIGID, "separate_bases": True}, 1e-10),
    "rigid, incompressible": ({**RIGID, "sensed_poisson": 0.5, "compliant_poisson": 0.5}, 1e-7),
    "thin, nearly incompressible": ({"sensed_poisson": 0.499999, "sensed_thickness": 3e-4}, 1e-7),
}


PLAIN = ("rigid, bonded", "rigid, incompressible")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in PLAIN else pytest.mark.slow) for name in SENSORS]
)
def test_a_curve_gives_what_a_solution_for_each_modulus_does(name: str) -> None:
    changed, within = SENSORS[name]
    sensor = replace(SolidParameters(), **changed)
    mesh = UNLIKE if name == "unlike degrees" else SMALL
    found = curve_on(sensor, mesh).poles
    for ratio in RATIOS:
        modulus = ratio * sensor.compliant_modulus
        known = direct(replace(sensor, sensed_modulus=modulus), mesh)
        assert solve_on(replace(sensor, sensed_modulus=modulus), mesh).force_ratio == pytest.approx(
            known.force_ratio, abs=within
        )
        voltages = found.voltages(np.array([modulus]))[0, :, 0]
        assert voltages == pytest.approx(known.voltages, rel=10 * within)


def test_the_energy_that_tears_a_closed_gap_is_finite_for_an_incompressible_ring() -> None:
    """What tears the ring from a rigid tooth strains it but keeps its volume. Error estimates count this energy."""
    closed = replace(SolidParameters(), **RIGID, ring_inner_radius=1.4e-3)
    soft, stiff = (curve_on(replace(closed, compliant_poisson=each), SMALL).poles.least for each in (0.498, 0.5))
    assert stiff == pytest.approx(soft, rel=5e-3)
