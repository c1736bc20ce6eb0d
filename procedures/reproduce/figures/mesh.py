"""Figure 4.6: the mesh of the single sensor, in the section of the round model and in the plan of the square one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric.mesh import grid, inside
from palpate.instrument.models.parameter_sets import PHYSICAL
from palpate.instrument.models.parameters import round_parameters, solid_parameters
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.reproduce.figures.picture import Picture, canvas, legend, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NUMBER = "Figure 4.6"
MM = 1e3
LAYERS, REFINEMENT = 3, 2  # coarse enough to show the grading in print
LOAD = PHYSICAL.load(100e3)  # the mesh is the same for every modulus
BODIES = {"object": "C3", "ring": "0.3", "tooth": "#b8860b", "upper plate": "C0", "lower plate": "C0"}
WORDS = {"upper plate": "plates", "lower plate": "_"}
# Shares along a side of an element, and the weights of its two ends and its middle there.
SHARE = np.linspace(0.0, 1.0, 9)
CURVE = np.array([(1 - SHARE) * (1 - 2 * SHARE), SHARE * (2 * SHARE - 1), 4 * SHARE * (1 - SHARE)])


def draw(folder: Path) -> Picture:
    """Draw both meshes. Raises RecordError."""
    drawing, (section, plan) = canvas(NUMBER, 2)
    _draw_section(section)
    elements = _draw_plan(plan)
    section.set(aspect="equal", xlabel="radius (mm)", ylabel="height (mm)", title="section: model axisymmetric")
    plan.set(aspect="equal", xlabel="x (mm)", ylabel="y (mm)", title="plan: model solid")
    legend(drawing, columns=4)
    caption = (
        f"Ours, not the mesh of the thesis. Left: model axisymmetric, {LAYERS} layers of elements that shrink towards"
        f" each corner, and polynomials of rising degree in each. Right: model solid, refinement {REFINEMENT},"
        f" {elements} elements in the plan of the whole sensor, extruded along the height."
    )
    return save(drawing, NUMBER, caption, folder)


def _draw_section(axes: Axes) -> None:
    from matplotlib.collections import LineCollection

    mesh = grid(round_parameters(get_design("single"), LOAD), LAYERS)
    for body in mesh.bodies:
        if body.name not in BODIES:
            continue  # a film is as thin as a line
        across, along = (
            inside(lines, extent) for lines, extent in ((mesh.radii, body.radii), (mesh.heights, body.heights))
        )
        radii, heights = (
            MM * lines[[*cut, cut[-1] + 1]] for lines, cut in ((mesh.radii, across), (mesh.heights, along))
        )
        upright = [[(r, heights[0]), (r, heights[-1])] for r in radii]
        level = [[(radii[0], z), (radii[-1], z)] for z in heights]
        words = WORDS.get(body.name, body.name)
        axes.add_collection(LineCollection([*upright, *level], colors=BODIES[body.name], linewidths=0.5, label=words))
    axes.autoscale_view()


def _draw_plan(axes: Axes) -> int:
    """Draw the plan; returns its number of elements."""
    from matplotlib.collections import LineCollection

    from palpate.instrument.models.solid.ladders import resolution
    from palpate.instrument.models.solid.mesh import GAP, OVERHANG, RING, TOOTH
    from palpate.instrument.models.solid.parts import Stack

    sensor = solid_parameters(get_design("single"), LOAD)
    plan = Stack(sensor, resolution(sensor, REFINEMENT), (False, False)).plan
    points: NDArray[np.float64] = MM * plan.mesh.doflocs[:, plan.mesh.dofs.element_dofs]
    for region, color in (
        (TOOTH, BODIES["tooth"]),
        (RING, BODIES["ring"]),
        (GAP, "0.8"),
        (OVERHANG, BODIES["upper plate"]),
    ):
        elements = points[:, :, plan.region == region]
        sides = [
            np.einsum("dne,ns->esd", elements[:, [first, second, middle]], CURVE)
            for first, second, middle in ((0, 1, 4), (1, 2, 5), (2, 3, 6), (0, 3, 7))
        ]
        axes.add_collection(LineCollection(list(np.concatenate(sides)), colors=color, linewidths=0.5))
    axes.autoscale_view()
    return int(points.shape[2])
