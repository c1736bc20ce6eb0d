"""Curves of the round sensor over the modulus of the object, beside solutions for one modulus at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.models.axisymmetric.curves import curve_on
from palpate.instrument.models.axisymmetric.direct import solve_on
from palpate.instrument.models.parameters import RoundParameters

CASE_A = RoundParameters()
RIGID = replace(CASE_A, support="rigid")
RATIOS = (1e-2, 4.0, 1e8)  # moduli of the object over the ring's
SENSORS = {
    "bonded": (CASE_A, 1e-10),
    "frictionless": (replace(CASE_A, interface="frictionless"), 1e-10),
    "capped": (replace(CASE_A, interface="capped"), 1e-10),
    "rigid, bonded": (RIGID, 1e-10),
    "rigid, frictionless": (replace(RIGID, interface="frictionless"), 1e-10),
    "rigid, capped": (replace(RIGID, interface="capped"), 1e-10),
    "closed gap": (replace(CASE_A, ring_inner_radius=CASE_A.tooth_radius), 1e-9),
    "narrow object": (replace(CASE_A, sensed_radius=3e-3), 1e-10),
    "incompressible": (replace(CASE_A, sensed_poisson=0.5, compliant_poisson=0.5), 1e-7),
    "rigid, incompressible": (replace(RIGID, sensed_poisson=0.5, compliant_poisson=0.5), 1e-7),
}


@pytest.mark.parametrize("name", SENSORS)
def test_a_curve_gives_what_a_solution_for_each_modulus_does(name: str) -> None:
    sensor, within = SENSORS[name]
    moduli = np.array(RATIOS) * sensor.compliant_modulus
    found = curve_on(sensor, 3, 1)
    ratios, stresses, voltages, charges = (
        of(moduli)[..., 0] for of in (found.force_ratios, found.values, found.voltages, found.shorted)
    )
    for k, modulus in enumerate(moduli):
        solution = solve_on(replace(sensor, sensed_modulus=float(modulus)), 3, 1)
        films = list(solution.films.values())
        assert ratios[k] == pytest.approx(solution.force_ratio, abs=within)
        scale = max((abs(film.normal_stress) for film in films), default=0.0)
        known = [stress for film in films for stress in (film.plane_stress, film.normal_stress)]
        assert stresses[k] == pytest.approx(known, abs=10 * within * scale)
        assert voltages[k] == pytest.approx([film.voltage for film in films], rel=10 * within)
        assert charges[k] == pytest.approx([film.charge for film in films], rel=10 * within)
