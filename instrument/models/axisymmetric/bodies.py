"""Element matrices of the round sensor: each body's material, and which bodies keep their pressure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric.mesh import Body
from palpate.instrument.models.axisymmetric.numbering import Numbering, Part
from palpate.instrument.models.finite_elements import elements as el
from palpate.instrument.models.finite_elements.condensed import Elements
from palpate.instrument.models.finite_elements.threads import Each

Array = NDArray[np.float64]

# Poisson ratios from which on a body keeps its pressure as an unknown: any body, and those that are of rubber.
MIXED_POISSON, RUBBER_MIXED_POISSON = 0.4, 0.2
RUBBER = ("object", "ring")
# Greatest λ/G in the factorised matrix; refinement steps carry the answer to the true one.
BULK_BOUND = 1e5
# Least compliance of the dilatation, over that of shear, with which pressures are eliminated.
LEAST_COMPLIANCE = 1e-4


def assemble(
    numbering: Numbering, r: el.Line, z: el.Line, bodies: list[Part], keeping: list[Part], each: Each
) -> Elements:
    """Element matrices of all bodies, per radian.

    Args:
        numbering: numbers of the unknowns.
        r, z: integrals over the radius and over the height.
        bodies: all bodies.
        keeping: bodies that keep their pressure as an unknown.
        each: runs a function for all subdomains at once.
    """
    stiffness, fill = np.empty((len(numbering.unknowns), *2 * numbering.unknowns.shape[1:])), el.Stiffness(r, z)
    mixed: list[int] = []
    pairs = r.dilatation.shape[1] ** 2
    dilatation = [np.zeros((0, pairs, numbering.unknowns.shape[1]))]
    compliance: list[float] = []
    bound: list[float] = []

    kept = [part.body for part in keeping]

    def filled(share: list[Part]) -> None:
        for part in share:
            fill(part.columns, part.rows, constants(part.body, part.body in kept), out=stiffness[part.elements])

    by_size, count = sorted(bodies, key=len, reverse=True), numbering.subdomains
    each(filled, [by_size[share::count] for share in range(count)])
    for part in keeping:
        shear = part.body.shear
        dilatation.append(el.dilatation(r, z, part.columns, part.rows))
        mixed += range(part.elements.start, part.elements.stop)
        compliance += [compliance_of(part.body) / shear] * len(part)
        bound += [1 / (BULK_BOUND * shear)] * len(part)
    return Elements(
        stiffness=stiffness,
        unknowns=numbering.unknowns,
        inner=numbering.inner,
        size=numbering.size,
        shared=numbering.shared,
        subdomain=numbering.subdomain,
        subdomains=numbering.subdomains,
        seam=numbering.seam,
        mixed=np.array(mixed, dtype=np.intp),
        dilatation=np.concatenate(dilatation),
        compliance=np.array(compliance),
        bound=np.array(bound),
    )


def constants(body: Body, mixed: bool) -> el.Constants:
    """Stiffness of the body's material; without the dilatation where the pressure is an unknown."""
    if body.film is not None:
        c, _, _ = body.film.stiff()
        return el.Constants(float(c[0, 0]), float(c[0, 1]), float(c[0, 2]), float(c[2, 2]), body.film.shear[0])
    nu, shear = body.poisson, body.shear
    return el.Constants.isotropic(shear, 0.0 if mixed else 2 * shear * nu / (1 - 2 * nu))


def keeps_pressure(body: Body) -> bool:
    """Whether a body keeps its pressure as an unknown, whatever its modulus.

    A nearly incompressible body would lock without it. Rubber that hard bodies press errs several times less with it.
    """
    return body.film is None and body.poisson >= (RUBBER_MIXED_POISSON if body.name in RUBBER else MIXED_POISSON)


def compliance_of(body: Body) -> float:
    """Compliance 1/λ of a body's dilatation over that of its shear, 1/G."""
    return (1 - 2 * body.poisson) / (2 * body.poisson)


def keeps_volume(body: Body) -> bool:
    """Whether a body's compliance is too small to eliminate its pressures with."""
    return keeps_pressure(body) and compliance_of(body) < LEAST_COMPLIANCE
