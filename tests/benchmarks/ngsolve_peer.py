"""The sensor by NGSolve, tuned as well as it can be: graded meshes, high order, static condensation.

In the plane it gets the very grid of our own model: its own mesh generator fills films of 25 µm with triangles
that are no longer than they are high. In space its mesh generator cuts the round sensor on a rigid support, which
has no film, and refines geometrically along the singular edges.
"""

from __future__ import annotations

import math
from typing import Any

from palpate.instrument.models.axisymmetric import mesh as own_mesh
from palpate.instrument.models.axisymmetric.mesh import inside
from palpate.instrument.models.parameters import RoundParameters


def axisymmetric_ratio(parameters: RoundParameters, degree: int, layers: int, threads: int) -> float:
    """Force ratio of a bonded sensor on elastic plates; tooth force from the mean stress of the tooth."""
    import ngsolve as ng

    ng.SetNumThreads(threads)
    grid = own_mesh.grid(parameters, layers)
    mesh = ng.Mesh(_quadrilaterals(grid))
    space = ng.VectorH1(mesh, order=degree, dirichletx="axis|floor", dirichlety="floor")
    moduli = {body.name: _moduli(body.modulus, body.poisson) for body in grid.bodies}
    shear, lame = (mesh.MaterialCF({name: pair[k] for name, pair in moduli.items()}) for k in (0, 1))
    r = ng.x

    def strain(u: Any) -> Any:
        slope = ng.Grad(u)
        return slope[0, 0], u[0] / r, slope[1, 1], slope[0, 1] + slope[1, 0]

    trial, test = space.TnT()
    e, d = strain(trial), strain(test)
    form = ng.BilinearForm(space, symmetric=True, condense=True)
    work = 2 * shear * sum(e[i] * d[i] for i in range(3)) + shear * e[3] * d[3] + lame * sum(e[:3]) * sum(d[:3])
    # Two orders above: the hoop term divides by the radius.
    form += r * work * ng.dx(bonus_intorder=2)
    load = ng.LinearForm(space)
    load += -2 / parameters.sensed_radius**2 * r * test[1] * ng.ds(definedon=mesh.Boundaries("top"))
    with ng.TaskManager():
        form.Assemble()
        load.Assemble()
        found = _solve(form, load, space)
        e = strain(found)
        stress = r * (2 * shear * e[2] + lame * sum(e[:3]))
        force = ng.Integrate(stress * ng.dx(definedon=mesh.Materials("tooth"), bonus_intorder=4), mesh)
    return -force / parameters.sensor_height


def solid_ratio(parameters: RoundParameters, degree: int, levels: int, size: float, threads: int) -> float:
    """Force ratio of a bonded round sensor on a rigid support, a quarter of it in space; size of elements [mm]."""
    import ngsolve as ng
    from netgen.occ import Box, Cylinder, Glue, OCCGeometry, Pnt, Z

    ng.SetNumThreads(threads)
    scale = 1e3
    outer, inner, tooth = (
        scale * getattr(parameters, name) for name in ("ring_outer_radius", "ring_inner_radius", "tooth_radius")
    )
    thickness = scale * parameters.sensed_thickness
    height = scale * (parameters.sensor_height + parameters.film_thickness)
    quarter = Box(Pnt(0, 0, -2 * height), Pnt(2 * outer, 2 * outer, 2 * thickness))
    body = Cylinder(Pnt(0, 0, 0), Z, r=outer, h=thickness) * quarter
    ring = Cylinder(Pnt(0, 0, -height), Z, r=outer, h=height) - Cylinder(Pnt(0, 0, -height), Z, r=inner, h=height)
    ring = ring * quarter
    # Stands for the rigid tooth: it marks the face that is held, and carries no unknowns.
    held = Cylinder(Pnt(0, 0, -height / 10), Z, r=tooth, h=height / 10) * quarter
    for part, name in ((body, "object"), (ring, "ring"), (held, "tooth")):
        part.mat(name)
    shape = Glue([body, ring, held])
    for face in shape.faces:
        x, y, z = face.center
        for name, at in (("x", x), ("y", y)):
            if abs(at) < 1e-9:
                face.name = name
        if abs(z - thickness) < 1e-9:
            face.name = "top"
        elif abs(z + height) < 1e-9:
            face.name = "floor"
        elif abs(z) < 1e-9 and math.hypot(x, y) < 0.7 * tooth:  # a quarter disc's middle; the gap's lies further out
            face.name = "face"
    for edge in shape.edges:
        start, end = (math.hypot(point.x, point.y) for point in (edge.start, edge.end))
        is_circle = abs(start - end) < 1e-9 < start and abs(edge.start.z - edge.end.z) < 1e-9
        if is_circle and any(abs(edge.start.z - z) < 1e-9 for z in (0, -height)):
            edge.hpref = 1
    mesh = ng.Mesh(OCCGeometry(shape).GenerateMesh(maxh=size, grading=0.5))
    if levels:
        mesh.RefineHP(levels, factor=0.2)
    mesh.Curve(degree)
    space = ng.VectorH1(
        mesh,
        order=degree,
        definedon=mesh.Materials("object|ring"),
        dirichletx="x|floor|face",
        dirichlety="y|floor|face",
        dirichletz="floor|face",
    )
    pairs = {
        "object": _moduli(parameters.sensed_modulus, parameters.sensed_poisson),
        "ring": _moduli(parameters.compliant_modulus, parameters.compliant_poisson),
        "tooth": (0.0, 0.0),
    }
    shear, lame = (mesh.MaterialCF({name: pair[k] for name, pair in pairs.items()}) for k in (0, 1))
    trial, test = space.TnT()
    form = ng.BilinearForm(space, symmetric=True, condense=True)
    e, d = (ng.Sym(ng.Grad(u)) for u in (trial, test))
    form += (2 * shear * ng.InnerProduct(e, d) + lame * ng.div(trial) * ng.div(test)) * ng.dx("object|ring")
    load = ng.LinearForm(space)
    load += -1 / (math.pi * outer**2 / 4) * test[2] * ng.ds(definedon=mesh.Boundaries("top"))
    with ng.TaskManager():
        form.Assemble()
        load.Assemble()
        found = _solve(form, load, space)
        lift = ng.GridFunction(space)
        lift.Set((0, 0, 1), definedon=mesh.Boundaries("face"))
        energy = ng.Integrate(
            (
                2 * shear * ng.InnerProduct(ng.Sym(ng.Grad(found)), ng.Sym(ng.Grad(lift)))
                + lame * ng.div(found) * ng.div(lift)
            )
            * ng.dx("object"),
            mesh,
        )
    return float(energy)


def _solve(form: Any, load: Any, space: Any) -> Any:
    import ngsolve as ng

    found = ng.GridFunction(space)
    right = load.vec.CreateVector()
    right.data = load.vec + form.harmonic_extension_trans * load.vec
    inverse = form.mat.Inverse(space.FreeDofs(coupling=True), inverse="sparsecholesky")
    found.vec.data = inverse * right
    found.vec.data += form.harmonic_extension * found.vec
    found.vec.data += form.inner_solve * load.vec
    return found


def _moduli(modulus: float, poisson: float) -> tuple[float, float]:
    return modulus / (2 * (1 + poisson)), modulus * poisson / ((1 + poisson) * (1 - 2 * poisson))


def _quadrilaterals(grid: own_mesh.Grid) -> Any:
    from netgen.meshing import Element1D, Element2D, FaceDescriptor, Mesh, MeshPoint, Pnt

    mesh = Mesh()
    mesh.dim = 2
    points: dict[tuple[int, int], Any] = {}

    def point(i: int, j: int) -> Any:
        if (i, j) not in points:
            points[i, j] = mesh.Add(MeshPoint(Pnt(float(grid.radii[i]), float(grid.heights[j]), 0)))
        return points[i, j]

    for index, body in enumerate(grid.bodies, 1):
        mesh.Add(FaceDescriptor(surfnr=index, domin=index, bc=index))
        mesh.SetMaterial(index, body.name)
        for i in inside(grid.radii, body.radii):
            for j in inside(grid.heights, body.heights):
                corners = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)]
                mesh.Add(Element2D(index, corners))
                for side, (a, b), is_there in (
                    (1, (3, 0), i == 0),
                    (2, (0, 1), j == 0),
                    (3, (2, 3), j == len(grid.heights) - 2),
                ):
                    if is_there:
                        mesh.Add(Element1D([corners[a], corners[b]], index=side))
    for side, name in enumerate(("axis", "floor", "top")):
        mesh.SetBCName(side, name)
    return mesh
