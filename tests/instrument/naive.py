"""What a plain program would do, beside which the shipped models are tested."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric import mesh
from palpate.instrument.models.beam import BeamSegment
from palpate.instrument.models.finite_elements import elements
from palpate.instrument.models.parameters import RoundParameters
from tests.instrument.direct_round import assemble

Array = NDArray[np.float64]


def lost_force(parameters: RoundParameters, degree: int, layers: int) -> float:
    """Share of the load that is lost before the floor of a rigid support: one sparse solve, forces K u from nodal u."""
    cut = mesh.grid(parameters, layers)
    lines = [elements.line(at, degree, radial) for at, radial in ((cut.radii, True), (cut.heights, False))]
    bodies = mesh.parts(cut)
    found = assemble(*mesh.number(parameters, cut, *lines, bodies), *lines, bodies, mixed=False)
    body, shapes = bodies[0], degree + 1
    radii = cut.radii[cut.radii <= parameters.sensed_radius]
    load = np.zeros(found.size + 1)
    top = found.unknowns[body.elements].reshape(len(body.columns), len(body.rows), 2, shapes, shapes)[:, -1, 1, :2, 1]
    a, b = radii[:-1], radii[1:]
    for place, weight in ((0, 2 * a + b), (1, a + 2 * b)):
        np.add.at(load, top[:, place], -(b - a) * weight / 6)
    displacement = np.append(scipy.sparse.linalg.spsolve(found.matrix(found.stiffness.copy()), load[:-1]), 0.0)
    forces = np.einsum("eij,ej->ei", elements.nodal(found.stiffness.copy()), displacement[found.unknowns])
    total = np.bincount(found.unknowns.ravel(), weights=forces.ravel(), minlength=found.size + 1)
    return abs(float((load - total)[:-1].sum() / load.sum()))


def beam_forces(bending: float, stretches: Sequence[BeamSegment], elements: int) -> list[float]:
    """Foundation forces as `beam.stretch_forces` has them, from the matrix on nodes as it stands."""
    lengths = np.repeat([stretch.length / elements for stretch in stretches], elements)
    foundations = np.repeat([stretch.foundation for stretch in stretches], elements)
    matrix, load = np.zeros((2 * len(lengths) + 2,) * 2), np.zeros(2 * len(lengths) + 2)
    x, w = (0.5 * each for each in np.polynomial.legendre.leggauss(4))
    x += 0.5
    for index, (h, foundation) in enumerate(zip(lengths, foundations, strict=True)):
        place = slice(2 * index, 2 * index + 4)
        # Hermite's shape functions at Gauss' points, and their curvatures.
        shapes = np.array([1 - 3 * x**2 + 2 * x**3, h * x * (1 - x) ** 2, 3 * x**2 - 2 * x**3, h * x**2 * (x - 1)])
        bent = np.array([12 * x - 6, h * (6 * x - 4), 6 - 12 * x, h * (6 * x - 2)])
        matrix[place, place] += bending / h**3 * bent * w @ bent.T + foundation * h * shapes * w @ shapes.T
        load[place] += np.array([h / 2, h**2 / 12, h / 2, -(h**2) / 12])
    motion = np.linalg.solve(matrix, load)
    pieces = lengths * (motion[:-2:2] + motion[2::2]) / 2 + lengths**2 * (motion[1:-2:2] - motion[3::2]) / 12
    return [float(part.sum()) for part in (foundations * pieces).reshape(len(stretches), elements)]
