"""The round model: curves, fields and hard shapes, beside solutions for one modulus at a time."""

from __future__ import annotations

import functools
import itertools
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import scipy
from skfem import ElementLinePp

from palpate.instrument.models.axisymmetric import model
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.axisymmetric.curves import FacePressure, RoundSection, curve_on, on, section
from palpate.instrument.models.axisymmetric.mesh import grid
from palpate.instrument.models.axisymmetric.model import resolution_of
from palpate.instrument.models.finite_elements.elements import shape_functions
from palpate.instrument.models.parameters import IDENTIFIED_ROUND, PHYSICAL, RoundParameters, round_parameters
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.material import FilmMaterial
from palpate.instrument.thesis import read_table
from tests.instrument.direct_round import DirectSolution, solve, solve_on
from tests.settings import round_sensors
from tests.shares import first_of

CASE_A = RoundParameters()
IDENTIFIED = round_parameters(IDENTIFIED_ROUND.design(get_design("single")), IDENTIFIED_ROUND.load(1e5))
# Degree 8 with 7 layers, in displacement-pressure and in plain displacement form: they differ by 1e-9.
CASE_A_RATIO = 0.4245274
# The same under a soft and under a hard object: under one alone the error may pass through zero.
RATIOS = {14.9e3: 0.1835738, CASE_A.sensed_modulus: CASE_A_RATIO, 1e6: 0.8246514}


@pytest.mark.slow
def test_the_error_falls_at_least_five_times_a_refinement() -> None:
    errors = [
        max(abs(solve(replace(CASE_A, sensed_modulus=m), refinement).force_ratio - RATIOS[m]) for m in RATIOS)
        for refinement in (1, 2, 3)
    ]
    assert errors[0] < 2e-4
    assert all(finer < coarser / 5 for coarser, finer in itertools.pairwise(errors))


def test_where_the_ratios_of_two_meshes_cross_the_estimate_is_above_the_error() -> None:
    """There the change of the ratio is no hint of the error that is left."""
    coarse, fine, finest = (axisymmetric.curve(CASE_A, refinement) for refinement in (1, 2, 3))

    def change(logarithm: float) -> float:
        modulus = np.exp([logarithm])
        return float((fine.force_ratios(modulus) - coarse.force_ratios(modulus))[0, 0])

    modulus = np.exp([scipy.optimize.brentq(change, np.log(24e3), np.log(24e4))])
    error = abs(fine.force_ratios(modulus) - finest.force_ratios(modulus))[0, 0]
    (estimate,), _ = axisymmetric.estimates([coarse, fine], CASE_A, modulus)
    assert abs(change(np.log(modulus[0]))) < error / 100
    assert error < estimate < 100 * error


def test_the_identified_set_gives_table_a2_1_within_0_008() -> None:
    """Every sixth row is checked here; `test_reproduce` checks all."""
    table = read_table("A2.1")
    rows = list(zip(table.keys(), table.values("force_rigid_N"), strict=True))
    assert len(rows) == 48
    for modulus, tooth_force in rows[::6]:
        ratio = solve(replace(IDENTIFIED, sensed_modulus=modulus), 1).force_ratio
        assert ratio == pytest.approx(-tooth_force, abs=0.008), f"{modulus:g} Pa"


def test_one_material_without_gap_carries_the_tooth_s_share_of_the_area() -> None:
    one = RoundParameters(
        **{f"{part}_modulus": 1e6 for part in ("sensed", "compliant", "tooth", "plate")},  # type: ignore[arg-type]
        **{f"{part}_poisson": 0.0 for part in ("sensed", "compliant", "tooth", "plate")},  # type: ignore[arg-type]
        film=FilmMaterial.isotropic(1e6, 0.0),
        ring_inner_radius=1.4e-3,
    )
    solution = solve(one, 1)
    # The object's node over the slit belongs to the tooth alone, which costs 1e-7 on this mesh.
    assert solution.force_ratio == pytest.approx((1.4 / 5) ** 2, rel=2e-7)
    assert solution.films["base"].normal_stress == pytest.approx(-1 / (math.pi * 5e-3**2), rel=1e-11)
    for film in solution.films.values():
        assert film.normal_stress == pytest.approx(-1 / (math.pi * 5e-3**2), rel=2e-7)
        assert abs(film.plane_stress) < 1e-6 * abs(film.normal_stress)


@pytest.mark.parametrize("nu", first_of([0.5, 0.49, 0.499, 0.4999, 0.499999]))
def test_rubber_up_to_poisson_ratio_one_half_keeps_its_accuracy(nu: float) -> None:
    rubber = replace(CASE_A, sensed_poisson=nu, compliant_poisson=nu)
    coarse, fine = solve(rubber, 1), solve(rubber, 2)
    assert abs(fine.force_ratio - coarse.force_ratio) < 1.5e-3
    assert fine.imbalance < 1e-10


def test_the_ratio_is_continuous_up_to_poisson_ratio_one_half() -> None:
    near, limit = (solve(replace(CASE_A, compliant_poisson=nu), 2).force_ratio for nu in (0.499999, 0.5))
    assert 0 < abs(near - limit) < 1e-5


@pytest.mark.slow
def test_the_ratio_is_continuous_as_the_gap_closes() -> None:
    ratios = [solve(replace(CASE_A, ring_inner_radius=1.4e-3 + gap), 2).force_ratio for gap in (1e-4, 1e-6, 1e-9, 0)]
    assert ratios[0] < ratios[1] < ratios[2]
    assert ratios[3] == pytest.approx(ratios[2], abs=3e-5)


@pytest.mark.parametrize("thickness", first_of([10e-6, 100e-3]))
def test_an_object_of_ten_micrometres_or_a_hundred_millimetres_is_resolved(thickness: float) -> None:
    thick = replace(CASE_A, sensed_thickness=thickness)
    assert solve(thick, 2).force_ratio == pytest.approx(solve(thick, 1).force_ratio, abs=1e-3)


def test_an_object_of_a_metre_takes_few_more_elements_than_one_of_millimetres() -> None:
    """Equal steps were two hundred for each metre, and 10 m took 3 GB."""
    low, high = (len(grid(replace(CASE_A, sensed_thickness=thickness), 3).heights) for thickness in (3e-3, 1.0))
    assert low < high < 2 * low


# --- Curves of the round sensor over the modulus of the object, beside solutions for one modulus at a time

RIGID = replace(CASE_A, support="rigid")
OVER_THE_RING = (1e-2, 4.0, 1e8)  # moduli of the object over the ring's
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
    moduli = np.array(OVER_THE_RING) * sensor.compliant_modulus
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
def test_a_foil_whose_curve_is_rounded_says_so() -> None:
    """One that bends on a soft ring: its stiffness is a difference of numbers that are larger by 1e10."""
    foil = replace(CASE_A, sensed_thickness=1e-5, sensed_poisson=0.5, sensed_modulus=24e11)
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


# --- The pressure on the sensor's face: what it adds up to, where it must be uniform, and where it may not


@functools.cache
def drawn(parameters: RoundParameters, refinement: int = 1) -> RoundSection:
    return section(parameters, *resolution_of(refinement))


@functools.cache
def solved(parameters: RoundParameters, refinement: int = 1) -> DirectSolution:
    return solve(parameters, refinement)


def force(face: FacePressure, reach: float = np.inf) -> float:
    """Integral of the pressure within a radius [N]."""
    return float((face.pressure * face.area)[face.radius < reach].sum())


@pytest.mark.parametrize(
    "parameters",
    [
        CASE_A,
        replace(CASE_A, interface="frictionless", sensed_poisson=0.5),
        replace(CASE_A, support="rigid", sensed_modulus=140e9),
        replace(CASE_A, sensed_radius=3e-3),
    ],
    ids=["case A", "sliding, incompressible", "hard, on rigid ground", "smaller than the ring"],
)
def test_the_pressure_adds_up_to_the_forces_on_tooth_and_face(parameters: RoundParameters) -> None:
    face = drawn(parameters).face
    assert force(face, parameters.tooth_radius) == pytest.approx(solved(parameters).tooth_force_above, rel=1e-7)
    assert force(face) == pytest.approx(1, rel=1e-7)
    assert face.radius.max() < min(parameters.sensed_radius, parameters.ring_outer_radius)
    assert not np.any((face.radius > parameters.tooth_radius) & (face.radius < parameters.ring_inner_radius))


@pytest.mark.slow
def test_over_a_closed_gap_both_integrals_meet_as_the_mesh_refines() -> None:
    closed = replace(CASE_A, ring_inner_radius=CASE_A.tooth_radius)
    differences = [
        abs(force(drawn(closed, k).face, closed.tooth_radius) / solved(closed, k).tooth_force_above - 1) for k in (1, 2)
    ]
    assert differences[1] < differences[0] / 2 < 1e-3


def test_one_material_without_gap_presses_evenly() -> None:
    one = RoundParameters(
        **{f"{part}_modulus": 1e6 for part in ("sensed", "compliant", "tooth", "plate")},  # type: ignore[arg-type]
        **{f"{part}_poisson": 0.0 for part in ("sensed", "compliant", "tooth", "plate")},  # type: ignore[arg-type]
        film=FilmMaterial.isotropic(1e6, 0.0),
        ring_inner_radius=1.4e-3,
    )
    face = drawn(one).face
    uneven = np.abs(face.pressure * math.pi * 5e-3**2 - 1)
    # One node of the ring at the slit is free, over some 40 nm; a tenth of a millimetre off it is forgotten.
    assert uneven[np.abs(face.radius - 1.4e-3) > 1e-4].max() < 1e-6
    assert np.average(uneven, weights=face.area) < 1e-5


@pytest.mark.parametrize(
    ("parameters", "within"),
    [
        (CASE_A, 1e-8),
        (replace(CASE_A, interface="capped"), 1e-8),
        (replace(CASE_A, support="rigid", interface="frictionless"), 1e-8),
        (replace(CASE_A, sensed_poisson=0.5, compliant_poisson=0.5), 1e-5),
    ],
    ids=["bonded", "capped", "rigid, frictionless", "incompressible"],
)
def test_the_drawn_displacements_are_those_of_a_solution_for_this_modulus(
    parameters: RoundParameters, within: float
) -> None:
    known, found, mesh = solved(parameters).on_mesh, drawn(parameters).fields, grid(parameters, resolution_of(1)[1])
    assert set(found) == set(known.parts)
    for name, part in known.parts.items():
        local = on(known.displacements, part)  # its first two shape functions in each direction belong to the corners
        field = found[name]
        assert field.radius[-1, 0] == mesh.radii[part.columns[-1] + 1]
        size = max(float(np.abs(local).max()), 1e-12)
        assert field.radial[-1, 0] == pytest.approx(local[-1, 0, 0, 1, 0], abs=within * size)
        assert field.axial[-1, -1] == pytest.approx(local[-1, -1, 1, 1, 1], abs=within * size)
        assert field.axial[0, 0] == pytest.approx(local[0, 0, 1, 0, 0], abs=within * size)


# --- The shape functions of the round sensor's elements ------------------------------------------------


@pytest.mark.parametrize("degree", [3, 6, 9])
def test_shape_functions_are_those_of_scikit_fem(degree: int) -> None:
    points, element = np.linspace(0, 1, 7), ElementLinePp(degree)
    theirs = [element.lbasis(points[None, :], index) for index in range(degree + 1)]
    values, slopes = shape_functions(degree, points)
    assert values == pytest.approx(np.array([value for value, _ in theirs]), abs=1e-14)
    assert slopes == pytest.approx(np.array([slope[0] for _, slope in theirs]), abs=1e-13)


@pytest.mark.slow
def test_a_round_sensor_is_set_up_without_scikit_fem() -> None:
    """Its import takes as long as a coarse mesh."""
    code = """
import sys
from palpate.instrument.models.axisymmetric.curves import found_on
from palpate.instrument.models.parameters import RoundParameters
found_on(RoundParameters(), 3, 1)
assert "skfem" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
