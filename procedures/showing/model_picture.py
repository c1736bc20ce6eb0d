"""Computes and draws the picture of a sensor under load: deformed sections, pressure on its face, and force ratios."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models.curve import ratio_curve
from palpate.instrument.models.parameters import get_parameter_set, round_parameters, solid_parameters
from palpate.instrument.models.response import RatioAnswer, RatioQuestion, ask
from palpate.instrument.models.solid.ladders import has_many_teeth
from palpate.instrument.models.table import MODELS
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import SAMPLES, Load
from palpate.instrument.thesis import read_table
from palpate.procedures.showing.figure import name_all, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from palpate.instrument.models.table import Response


Array = NDArray[np.float64]

CURVES = ("column", "beam", "surface", "axisymmetric")
SECTION_REFINEMENT = 4  # finer than for forces, because pressure at a point converges more slowly
SOLID_REFINEMENT, MANY_TEETH_REFINEMENT = 1, 0  # the finest meshes that take only seconds
CURVE_TOLERANCE = 1e-3  # an error that is smaller than the width of a line
SOFTER, HARDER = 0.1, 1e4  # ends of the curves, as multiples of the ring's modulus
LARGEST = 0.12  # greatest drawn displacement, as a fraction of the section's height


@dataclass(frozen=True, slots=True)
class PlottedBody:
    """A piece of a body in the plane of a section, as a grid of points.

    Attributes:
        x: position across [m].
        z: height [m].
        right: displacement along x for 1 N [m].
        up: displacement along z for 1 N [m].
    """

    x: Array
    z: Array
    right: Array
    up: Array


@dataclass(frozen=True, slots=True)
class PlottedSection:
    """The plane through the teeth's axes, under 1 N.

    Attributes:
        across: label of x.
        bodies: the pieces of each body, by its name.
        x: ascending positions on the sensor's face where the object touches it [m].
        pressure: pressure at `x`, positive in compression [Pa].
        teeth: both ends of each tooth along x [m].
        edges: positions where a contact ends, and the pressure is singular [m].
        mean: mean pressure on the object [Pa].
    """

    across: str
    bodies: Mapping[str, tuple[PlottedBody, ...]]
    x: Array
    pressure: Array
    teeth: tuple[tuple[float, float], ...]
    edges: Array
    mean: float

    @property
    def largest(self) -> dict[str, float]:
        """Greatest displacement of each body [m]."""
        return {
            name: max(float(np.hypot(piece.right, piece.up).max()) for piece in pieces)
            for name, pieces in self.bodies.items()
        }

    @property
    def height(self) -> float:
        """Height of all bodies together [m]."""
        pieces = [piece for body in self.bodies.values() for piece in body]
        return float(max(piece.z.max() for piece in pieces) - min(piece.z.min() for piece in pieces))


def _round_section(design: Design, load: Load) -> PlottedSection:
    from palpate.instrument.models.axisymmetric import curves, model

    parameters = round_parameters(design, load)
    found = curves.section(parameters, *model.resolution_of(SECTION_REFINEMENT))
    bodies = {name: _both_sides(PlottedBody(f.radius, f.height, f.radial, f.axial)) for name, f in found.fields.items()}
    tooth, end = parameters.tooth_radius, min(parameters.sensed_radius, parameters.ring_outer_radius)
    return PlottedSection(
        across="radius",
        bodies=bodies,
        x=found.face.radius,
        pressure=found.face.pressure,
        teeth=((-tooth, tooth),),
        edges=np.array([tooth, parameters.ring_inner_radius, end]),
        mean=1 / (math.pi * parameters.sensed_radius**2),
    )


def _both_sides(half: PlottedBody) -> tuple[PlottedBody, ...]:
    """A body of revolution from its half at x >= 0: one piece if it reaches the axis, else two."""
    other = PlottedBody(-half.x[::-1], half.z[::-1], -half.right[::-1], half.up[::-1])
    if half.x.min() > 0:
        return other, half
    pairs = ((other.x, half.x), (other.z, half.z), (other.right, half.right), (other.up, half.up))
    return (PlottedBody(*(np.concatenate([left[:-1], right]) for left, right in pairs)),)


def _solid_section(design: Design, load: Load) -> PlottedSection:
    from palpate.instrument.models.solid import system as solid_section

    parameters = solid_parameters(design, load)
    refinement = MANY_TEETH_REFINEMENT if has_many_teeth(parameters) else SOLID_REFINEMENT
    found = solid_section.section(parameters, refinement)
    axes = (np.arange(parameters.columns) + 0.5) * parameters.cell_length
    radii = np.array([parameters.tooth_radius, parameters.ring_inner_radius])
    if parameters.ring_outline == "round":
        radii = np.append(radii, parameters.ring_outer_radius)
    edges = np.concatenate([(axes[:, None] + np.array([-1, 1])[:, None, None] * radii).ravel(), [0, parameters.length]])
    return PlottedSection(
        across="place along the sensor",
        bodies={
            name: tuple(PlottedBody(piece.x, piece.z, piece.along, piece.up) for piece in pieces)
            for name, pieces in found.bodies.items()
        },
        x=found.x,
        pressure=found.pressure,
        teeth=tuple((axis - parameters.tooth_radius, axis + parameters.tooth_radius) for axis in axes.tolist()),
        edges=np.unique(edges),
        mean=1 / parameters.load_area,
    )


# The models that compute displacements inside the sensor.
SECTIONS: Mapping[str, Callable[[Design, Load], PlottedSection]] = {
    "axisymmetric": _round_section,
    "solid": _solid_section,
}


@dataclass(frozen=True, slots=True)
class ModelPicture:
    """The numbers of a picture.

    Attributes:
        question: the design, model and settings that were asked for.
        answers: the model's answer at each modulus that was asked for.
        sections: the section at each of these moduli; empty if the model computes none.
        curves: moduli [Pa] and force ratios of each model that holds for the sensor, by the model's name.
        thesis: moduli [Pa] and force ratios that the thesis gives for the design, by their origin.
    """

    question: RatioQuestion
    answers: list[RatioAnswer]
    sections: list[PlottedSection]
    curves: dict[str, tuple[Array, Array]]
    thesis: dict[str, tuple[Array, Array]]

    @property
    def scale(self) -> float:
        """Magnification of the displacements in the drawing: 1, 2 or 5 times a power of ten."""
        section = self.sections[0]
        wanted = LARGEST * section.height / max(section.largest.values())
        power = 10.0 ** math.floor(math.log10(wanted))
        return next(step for step in (5 * power, 2 * power, power) if step <= wanted)

    def data(self) -> dict[str, Any]:
        """The numbers in the picture, for JSON."""
        sections = zip(self.answers, self.sections, strict=False)
        return {
            "design": self.question.design,
            "parameters": self.question.parameters,
            "model": self.question.model,
            "points": [
                {
                    "sensed_modulus_Pa": answer.sensed_modulus,
                    "force_ratio": answer.response.force_ratio,
                    "error_estimate": answer.response.error_estimate,
                }
                for answer in self.answers
            ],
            "deformation": {
                "sensed_modulus_Pa": self.answers[0].sensed_modulus,
                "scale": self.scale,
                "largest_displacement_m": self.sections[0].largest,
            }
            if self.sections
            else None,
            "pressure": [
                {
                    "sensed_modulus_Pa": answer.sensed_modulus,
                    "x_m": section.x.tolist(),
                    "pressure_Pa": section.pressure.tolist(),
                }
                for answer, section in sections
            ],
            "curves": _columns(self.curves),
            "thesis": _columns(self.thesis),
        }


def _columns(lines: Mapping[str, tuple[Array, Array]]) -> dict[str, Any]:
    return {
        name: {"sensed_modulus_Pa": moduli.tolist(), "force_ratio": ratios.tolist()}
        for name, (moduli, ratios) in lines.items()
    }


def solve(question: RatioQuestion, moduli: Sequence[float]) -> ModelPicture:
    """Compute the picture for objects with these moduli [Pa].

    Raises:
        RangeError: a modulus or setting is outside its limits, or the model does not hold for this sensor.
        EstimateError: a linear system cannot be solved accurately.
    """
    answers = ask(question, moduli)
    design = question.sensor()
    section = SECTIONS.get(answers[0].response.model)
    sections = [] if section is None else [section(design, question.load(modulus)) for modulus in moduli]
    thesis = _thesis(design)
    ring = design.ring.material.modulus
    shown = np.concatenate([[SOFTER * ring, HARDER * ring], moduli, *(found for found, _ in thesis.values())])
    curves: dict[str, tuple[Array, Array]] = {}
    for model in CURVES:
        parameters = _parameters(question, model)
        label = model if parameters == question.parameters else f"{model}, {parameters} parameters"
        line = _line(RatioQuestion(question.design, model, parameters, question.settings), shown)
        if line is not None:
            curves[label] = line
    return ModelPicture(question, answers, sections, curves, thesis)


def _parameters(question: RatioQuestion, model: str) -> str:
    """Name of the question's parameter set, or of the physical set if the model has no set of that name."""
    try:
        get_parameter_set(question.parameters, model)
    except UnknownName:
        return "physical"
    return question.parameters


def _line(question: RatioQuestion, shown: Array) -> tuple[Array, Array] | None:
    """Moduli [Pa] and force ratios of a model over the shown range; None: the model does not hold for the sensor."""
    sensor, tolerance = question.sensor(), MODELS[question.model].default_tolerance
    load = question.load(sensor.ring.material.modulus)
    try:
        curve = ratio_curve(sensor, load, question.model, None if tolerance is None else CURVE_TOLERANCE)
    except RangeError:
        return None
    least, greatest = curve.moduli
    moduli = np.geomspace(max(shown.min(), least), min(shown.max(), greatest), 200)
    return moduli, curve.force_ratio(moduli)


def _thesis(design: Design) -> dict[str, tuple[Array, Array]]:
    found = {}
    if design.name == "single":
        table = read_table("A2.1")
        ratios = table.values("force_rigid_N") / table.values("force_total_N")
        found["thesis, finite elements (A2.1)"] = (table.keys(), ratios)
    if design.thesis_force_ratio:
        moduli = np.array([SAMPLES[name].modulus for name in design.thesis_force_ratio])
        found["thesis, measured means"] = (moduli, np.array(list(design.thesis_force_ratio.values())))
    return found


# -------------------------------------------------------------------------------------------------------
# Draws a sensor under load: the deformed section, the pressure on its face, the force ratio over the modulus


EDGE = 0.05  # fraction of a tooth's width; closer to an edge the singular pressure does not count for the scale
LABELLED = ("object", "ring", "tooth")  # bodies that are thick enough for their names
THESIS_STYLES = ("k.", "r^")


def draw(picture: ModelPicture, file: Path) -> None:
    """Draw a picture into a file.

    Raises:
        RecordError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    drawings = [_draw_deformation, _draw_pressure, _draw_ratio] if picture.sections else [_draw_ratio]
    figure = Figure(figsize=(5.6 * len(drawings), 4.6), layout="constrained")
    question = picture.question
    figure.suptitle(f"design {question.design}, model {question.model}, {question.parameters} parameters")
    for number, drawing in enumerate(drawings, start=1):
        drawing(picture, figure.add_subplot(1, len(drawings), number))
    write(figure, file)


def _draw_deformation(picture: ModelPicture, axes: Axes) -> None:
    section, scale = picture.sections[0], picture.scale
    largest = 1e6 * max(section.largest.values())
    for name, pieces in section.bodies.items():
        for piece in pieces:
            x, z = 1e3 * (piece.x + scale * piece.right), 1e3 * (piece.z + scale * piece.up)
            size = 1e6 * np.hypot(piece.right, piece.up)
            image = axes.pcolormesh(x, z, size, shading="gouraud", cmap="viridis", vmin=0, vmax=largest)
            axes.plot(_outline(1e3 * piece.x), _outline(1e3 * piece.z), color="0.5", lw=0.6, ls="--")
            axes.plot(_outline(x), _outline(z), color="k", lw=0.8)
        if name in LABELLED:
            widest = max(pieces, key=lambda piece: float(np.ptp(piece.x)))
            middle, height = ((side.min() + side.max()) / 2 for side in (widest.x, widest.z))
            axes.annotate(name, (1e3 * middle, 1e3 * height), ha="center", va="center", color="w")
    axes.figure.colorbar(image, ax=axes, label="displacement for 1 N (µm)", shrink=0.8)
    modulus = show(picture.answers[0].sensed_modulus, "Pa")
    axes.set(aspect="equal", xlabel=f"{section.across} (mm)", ylabel="height (mm)")
    axes.set_title(f"object of {modulus}, displacements × {scale:g}; dashed: unloaded", fontsize=10)


def _outline(values: Array) -> Array:
    """Values along the outline of a body: its lower side, its outer end, and back along its upper side."""
    return np.concatenate([values[:, 0], values[-1], values[::-1, -1]])


def _draw_pressure(picture: ModelPicture, axes: Axes) -> None:
    highest = 0.0
    for answer, section in zip(picture.answers, picture.sections, strict=True):
        pressure = np.where(section.pressure > 0, section.pressure, np.nan) / 1e3
        breaks = np.searchsorted(section.x, section.edges)
        axes.plot(
            np.insert(1e3 * section.x, breaks, np.nan), np.insert(pressure, breaks, np.nan), lw=1.2,
            label=f"{show(answer.sensed_modulus, 'Pa')}: {_taken(answer.response)}",
        )  # fmt: skip
        far = np.abs(section.x[:, None] - section.edges).min(axis=1) > EDGE * np.ptp(section.teeth[0])
        highest = max(highest, float(section.pressure[far].max()) / 1e3)
    section = picture.sections[0]
    for start, end in section.teeth:
        axes.axvspan(1e3 * start, 1e3 * end, color="C7", alpha=0.2, lw=0)
    axes.axhline(section.mean / 1e3, color="k", lw=0.8, ls="--", label="mean over the object")
    axes.set(
        yscale="log", xlim=(0, 1e3 * section.edges[-1]), ylim=(section.mean / 5e4, 4 * highest),
        xlabel=f"{section.across} (mm); shaded: {'tooth' if len(section.teeth) == 1 else 'teeth'}",
        ylabel="pressure on the sensor's face for 1 N (kPa)",
    )  # fmt: skip
    axes.set_title("singular at the edges and clipped there; tension is not shown", fontsize=10)
    axes.grid(alpha=0.3)
    name_all(axes, 2)


def _taken(response: Response) -> str:
    who = "tooth takes" if len(response.tooth_forces) == 1 else "teeth take"
    return f"{who} {100 * response.force_ratio:z.1f} %"


def _draw_ratio(picture: ModelPicture, axes: Axes) -> None:
    for name, (moduli, ratios) in picture.curves.items():
        axes.plot(moduli / 1e3, ratios, lw=1.2, label=name)
    for (name, (moduli, ratios)), style in zip(picture.thesis.items(), THESIS_STYLES, strict=False):
        axes.plot(moduli / 1e3, ratios, style, ms=4, mfc="none", label=name)
    moduli = np.array([answer.sensed_modulus for answer in picture.answers])
    ratios = np.array([answer.response.force_ratio for answer in picture.answers])
    axes.plot(moduli / 1e3, ratios, "ko", ms=5, label=f"{picture.question.model}, as asked")
    axes.set(
        xscale="log", ylim=(0, 1.02), xlabel="Young modulus of the sensed object (kPa)",
        ylabel="force ratio, tooth over all",
    )  # fmt: skip
    axes.set_title("force ratio", fontsize=10)
    axes.grid(alpha=0.3)
    name_all(axes, 2)
