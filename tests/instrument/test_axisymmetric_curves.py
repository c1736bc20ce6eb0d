"""Curves of the round sensor over the modulus of the object, beside solutions for one modulus at a time."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.models.axisymmetric import model
from palpate.instrument.models.axisymmetric.curves import curve_on
from palpate.instrument.models.axisymmetric.mesh import grid
from palpate.instrument.models.parameters import PHYSICAL, RoundParameters, round_parameters
from palpate.instrument.sensor.designs import get_design
from tests.instrument.direct_round import solve_on
from tests.settings import round_sensors
from tests.shares import first_of

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


@pytest.mark.parametrize("name", first_of(list(SENSORS)))
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


@pytest.mark.parametrize("sensor", [CASE_A, *round_sensors(5, seed=5)], ids=lambda sensor: f"{sensor.tooth_radius:.2e}")
def test_a_finer_mesh_keeps_all_lines_of_the_coarser_one(sensor: RoundParameters) -> None:
    """Only then do energies tell how far a mesh may be off."""
    for layers in (2, 3, 4):
        coarse, fine = grid(sensor, layers), grid(sensor, layers + 1)
        for few, many in ((coarse.radii, fine.radii), (coarse.heights, fine.heights)):
            assert np.abs(few[:, None] - many).min(axis=1).max() <= 1e-12 * many[-1]


@pytest.mark.slow
@pytest.mark.parametrize("poisson", [0.3, 0.5])
def test_a_foil_whose_curve_is_rounded_says_so(poisson: float) -> None:
    """One that bends on a soft ring: its stiffness is a difference of numbers that are larger by 1e10."""
    foil = replace(CASE_A, sensed_thickness=1e-5, sensed_poisson=poisson, sensed_modulus=24e11)
    curves = [model.curve(foil, refinement) for refinement in (1, 2)]
    error = abs(model.solve(foil, 2).force_ratio - solve_on(foil, 4, 3).force_ratio)
    assert 1e-8 < error < model.rounding(curves, foil, np.array([foil.sensed_modulus]))[0][0]


def test_the_designs_are_nothing_special_and_a_tall_column_beside_a_gap_is_looked_at_for_rounding() -> None:
    for name in ("single", "single_round"):
        sensor = round_parameters(get_design(name), PHYSICAL.load(1e5))
        assert not model.may_round(sensor)
    tall, narrow = replace(CASE_A, sensed_thickness=0.1), replace(CASE_A, ring_inner_radius=1.41e-3)
    assert model.may_round(tall) and not model.is_special(tall)
    assert model.is_special(narrow)


@pytest.mark.slow
@pytest.mark.timeout(60)
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a process its own greatest memory")
def test_the_finest_mesh_of_a_foil_takes_no_more_than_300_mb() -> None:
    code = """
from pathlib import Path
from palpate.instrument.models.axisymmetric import curves, model
from palpate.instrument.models.parameters import RoundParameters
curves.found_on(RoundParameters(sensed_thickness=1e-5), *model.resolution_of(model.REFINEMENTS[-1]))
# its own: `getrusage` also counts what its parent had when it began
print(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 300e3  # kB
