"""Figure 4.18: under load the ring gives way and the tooth stands out, so that the sensor holds like a tooth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.instrument.models.axisymmetric import direct
from palpate.instrument.models.parameter_sets import PHYSICAL
from palpate.instrument.models.parameters import round_parameters
from palpate.instrument.quantity import show
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.reproduce.figures.picture import Picture, canvas, save

NUMBER = "Figure 4.18"
SAMPLE, REFINEMENT = "2", 1  # the softest
MM = 1e3
COLORS = {"object": "#f2cfc0", "ring": "0.35", "tooth": "#e8e2c8"}
DRAWN = 0.6  # mm, the greatest displacement in the drawing


def draw(folder: Path) -> Picture:
    """Draw the upper part of the sensor, half at rest and half under load. Raises RecordError."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Rectangle

    parameters = round_parameters(get_design("single"), PHYSICAL.load(get_sample(SAMPLE).modulus))
    fields = direct.solve(parameters, REFINEMENT).fields
    bodies = [name for name in COLORS if name in fields]
    largest = max(float(np.hypot(fields[name].radial, fields[name].axial).max()) for name in bodies)
    force = DRAWN / (MM * largest)  # N; linear
    drawing, (axes,) = canvas(NUMBER)
    for name in bodies:
        field = fields[name]
        at_rest = (MM * field.radius, MM * field.height)
        pressed = (MM * field.radius + force * MM * field.radial, MM * field.height + force * MM * field.axial)
        for sign, (r, z) in ((-1, at_rest), (1, pressed)):
            outline = np.column_stack([sign * _around(r), _around(z)])
            axes.add_collection(
                PolyCollection(
                    [outline], facecolors=COLORS[name], edgecolors="k", linewidths=0.7, label=name if sign > 0 else "_"
                )
            )
    ring = fields["ring"]
    floor = MM * float(ring.height.min())
    axes.axvline(0, color="0.3", ls="-.", lw=0.8)
    top = MM * max(float(fields[name].height.max()) for name in bodies)
    for x, words in ((-2.5, "at rest"), (2.5, "pressed")):
        axes.text(x, top + 0.25, words, ha="center", fontsize=9)
    tooth, face = fields["tooth"], ring.axial[:, -1]
    proud = 1e6 * force * (float(np.mean(tooth.axial[:, -1])) - float(np.mean(face)))
    axes.add_patch(Rectangle((-5.0, floor - 0.25), 10.0, 0.25, fc="0.85", ec="none"))
    axes.set(aspect="equal", xlim=(-5.6, 5.6), ylim=(floor - 0.3, top + 0.8), xlabel="radius (mm)")
    axes.yaxis.set_visible(False)
    axes.spines[["left", "right", "top"]].set_visible(False)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    caption = (
        f"Ours (predicted): the round single sensor under sample {SAMPLE}, {show(get_sample(SAMPLE).modulus, 'Pa')}, by"
        f" model axisymmetric with the physical set, to scale under {force:.2g} N: the tooth stands {proud:.0f} µm"
        " above the ring's mean height."
    )
    return save(drawing, NUMBER, caption, folder)


def _around(grid: np.ndarray) -> np.ndarray:
    """A grid's values along its edge."""
    return np.concatenate([grid[:, 0], grid[-1], grid[::-1, -1], grid[0, ::-1]])
