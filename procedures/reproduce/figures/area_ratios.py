"""Figure 4.4: the force ratio over λ for several ratios of the areas of ring and tooth."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.instrument.models.foundation import springs
from palpate.instrument.models.parameter_sets import PHYSICAL
from palpate.instrument.models.response import response
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.reproduce.figures.picture import Picture, canvas, legend, save

NUMBER = "Figure 4.4"
AREA_RATIOS = (1.0, 2.0, 5.0, 10.0, 20.0)  # the text praises 1 to 10, and finds steeper curves beyond
LAMBDAS = np.geomspace(1e-2, 1e4, 37)


def draw(folder: Path) -> Picture:
    """Draw columns and beam for several area ratios and the sensor's own. Raises RecordError."""
    drawing, (axes,) = canvas(NUMBER)
    sensor = get_design("single")
    own = sensor.ring.area / sensor.tooth.area
    thickness = PHYSICAL.sensed_thickness
    for place, ratio in enumerate(sorted((*AREA_RATIOS, own))):
        design = with_area_ratio(sensor, ratio)
        moduli = LAMBDAS * design.ring.material.modulus * thickness / design.ring.height
        columns = springs.ratio_of_modulus(design, moduli, thickness)
        beam = [response(design, PHYSICAL.load(float(modulus)), "beam").force_ratio for modulus in moduli]
        label = f"A = {ratio:.4g}{', the sensor' if ratio == own else ''}"
        axes.plot(LAMBDAS, columns, color=f"C{place}", lw=1.4, label=f"{label}: columns")
        axes.plot(LAMBDAS, beam, "--", color=f"C{place}", lw=1.0, label=f"{label}: beam")
    axes.set(
        xscale="log", ylim=(0, 1.02), xlabel="λ = E1 T2 / (E2 T1)", ylabel="force ratio: tooth over total"
    )  # fmt: skip
    axes.grid(alpha=0.3)
    legend(drawing, columns=3)
    caption = (
        "The thesis prints no numbers of it, and its area ratios are not readable: nothing can be compared."
        " Columns: R = a (1 + λ) / (1 + a λ) with the tooth's share a = 1 / (1 + A) of the area. Beam: on a ring whose"
        f" outer radius gives the area ratio A of ring to tooth; the sensor's own is {own:.2f}, printed 11.60."
        f" The object is {1e3 * thickness:g} mm thick."
    )
    return save(drawing, NUMBER, caption, folder)


def with_area_ratio(sensor: Design, ratio: float) -> Design:
    """The sensor with another area of the ring over that of the tooth."""
    outer = math.sqrt(sensor.ring.inner_radius**2 + ratio * sensor.tooth.radius**2)
    ring = replace(sensor.ring, outer_radius=outer)
    # A ring that is wider than the plates gets wider plates.
    half = max(outer, sensor.plate.length / 2)
    plate = replace(sensor.plate, length=2 * half, width=2 * half)
    return replace(sensor, ring=ring, plate=plate, teeth=((half, half),))
