"""A sensor under load, drawn: the deformed section, the pressure on its face, the force ratio over the modulus."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from instrument.design import Design
from instrument.errors import UnknownName, UsageError
from instrument.load import Load
from instrument.models.curve import RatioCurve, ratio_curve
from instrument.models.parameters import round_parameters
from instrument.models.ratio import Answer, Question, ask
from instrument.models.response import AXISYMMETRIC_TOLERANCE
from instrument.quantity import show
from instrument.sample import SAMPLES
from procedures.run import storing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

CURVES = ("column", "beam", "axisymmetric")
CURVE_TOLERANCE = 1e-3  # less than the width of a line
SOFTER, HARDER = 0.1, 1e4  # ends of the curves, over the modulus of the ring
LARGEST = 0.12  # greatest displacement drawn, over the height of the picture
EDGE = 0.02  # of the tooth's radius: nearer to an edge the pressure does not set the scale


@dataclass(frozen=True, slots=True)
class Body:
    """A body in the plane of a section: points on a grid, and their displacements for 1 N [m]."""

    x: Array
    z: Array
    right: Array
    up: Array


@dataclass(frozen=True, slots=True)
class Section:
    """The plane through the axis of a tooth, for 1 N; the tooth's axis is at x = 0.

    Attributes:
        bodies: by name; the half at x >= 0.
        x: places on the sensor's face [m], where the object touches it.
        pressure: there, compression positive [Pa].
        tooth: radius of the tooth [m].
        mean: pressure on the object [Pa].
    """

    bodies: Mapping[str, Body]
    x: Array
    pressure: Array
    tooth: float
    mean: float


def _round_section(design: Design, load: Load, tolerance: float | None) -> Section:
    from instrument.models import axisymmetric

    parameters = round_parameters(design, load)
    solution, _ = axisymmetric.solve_to(parameters, tolerance or AXISYMMETRIC_TOLERANCE)
    bodies = {name: Body(f.radius, f.height, f.radial, f.axial) for name, f in solution.fields.items()}
    area = math.pi * parameters.sensed_radius**2
    return Section(bodies, solution.face.radius, solution.face.pressure, solution.face.reach, 1 / area)


# Of the models that know what happens inside the sensor.
SECTIONS: Mapping[str, Callable[[Design, Load, float | None], Section]] = {"axisymmetric": _round_section}


@dataclass(frozen=True, slots=True)
class Picture:
    """What is drawn.

    Attributes:
        answers: by the model that was asked, at the moduli that were asked for.
        sections: at those moduli; none where the model knows no section.
        curves: of that model, if in closed form, and of others that know the design.
        measured: sample -> modulus [Pa] and mean force ratio of the thesis' experiment.
    """

    question: Question
    answers: list[Answer]
    sections: list[Section]
    curves: dict[str, tuple[Array, Array]]
    measured: dict[str, tuple[float, float]]

    @property
    def scale(self) -> float:
        """Of the displacements in the drawing: 1, 2 or 5 times a power of ten."""
        bodies = self.sections[0].bodies.values()
        largest = max(float(np.hypot(body.right, body.up).max()) for body in bodies)
        height = max(float(body.z.max()) for body in bodies)
        wanted = LARGEST * height / largest
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
                "largest_displacement_m": {
                    name: float(np.hypot(body.right, body.up).max()) for name, body in self.sections[0].bodies.items()
                },
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
            "curves": {
                name: {"sensed_modulus_Pa": moduli.tolist(), "force_ratio": ratios.tolist()}
                for name, (moduli, ratios) in self.curves.items()
            },
            "measured": {
                name: {"sensed_modulus_Pa": modulus, "force_ratio": ratio}
                for name, (modulus, ratio) in self.measured.items()
            },
        }


def solve(question: Question, moduli: Sequence[float]) -> Picture:
    """Everything that is drawn for objects of these moduli [Pa].

    Raises:
        RangeError: a modulus or setting is out of its limits, or the model does not answer for this sensor.
        EstimateError: a linear system cannot be solved accurately.
    """
    answers = ask(question, moduli)
    design = question.sensor()
    section = SECTIONS.get(answers[0].response.model)
    sections = [] if section is None else [section(design, question.load(m), question.tolerance) for m in moduli]
    measured = {name: (SAMPLES[name].modulus, ratio) for name, ratio in sorted(design.thesis_force_ratio.items())}
    ring = design.ring.material.modulus
    shown = [SOFTER * ring, HARDER * ring, *moduli, *(modulus for modulus, _ in measured.values())]
    curves = {
        name: _line(curve, min(shown), max(shown)) for name in CURVES if (curve := _curve(question, name)) is not None
    }
    return Picture(question, answers, sections, curves, measured)


def _curve(question: Question, model: str) -> RatioCurve | None:
    """Of a model that knows the sensor; None: it does not."""
    try:
        own = Question(question.design, model, question.parameters, question.settings)
    except UnknownName:
        return None  # nothing was identified for it
    sensor = own.sensor()
    if model in SECTIONS and len(sensor.teeth) > 1:
        return None
    load = own.load(sensor.ring.material.modulus)
    return ratio_curve(sensor, load, model, CURVE_TOLERANCE if model in SECTIONS else None)


def _line(curve: RatioCurve, low: float, high: float) -> tuple[Array, Array]:
    least, greatest = curve.moduli
    moduli = np.geomspace(max(low, least), min(high, greatest), 200)
    return moduli, curve.force_ratio(moduli)


def draw(picture: Picture, out: Path | None, store: Path) -> Path:
    """Writes the picture as PNG and returns its path.

    Args:
        out: the file; None: a new one in `plots/` of the store, named after time, design and model.

    Raises:
        UsageError: the name does not end in .png, or the file exists.
        RecordError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    question = picture.question
    if out is None:
        stamp = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
        out = store / "plots" / f"{stamp}-{question.design}-{question.model}.png"
        with storing(out):
            out.parent.mkdir(parents=True, exist_ok=True)
    check_file(out)
    drawings = [_draw_ratio]
    if picture.sections:
        drawings = [_draw_deformation, _draw_pressure, _draw_ratio]
    figure = Figure(figsize=(6 * len(drawings), 4.8), layout="constrained")
    figure.suptitle(f"design {question.design}, model {question.model}, {question.parameters} parameters")
    for place, drawing in enumerate(drawings, start=1):
        drawing(picture, figure.add_subplot(1, len(drawings), place))
    with storing(out):
        figure.savefig(out, dpi=120, metadata={"Software": None})
    return out.absolute()


def check_file(out: Path) -> None:
    """Raises UsageError: the name does not end in .png, or the file exists."""
    if out.suffix != ".png":
        raise UsageError(f"{out} does not end in .png; a picture is written in this format only")
    if out.exists():
        raise UsageError(f"{out} exists and is not overwritten; choose another --out")


def _draw_deformation(picture: Picture, axes: Axes) -> None:
    section, scale = picture.sections[0], picture.scale
    largest = max(float(np.hypot(body.right, body.up).max()) for body in section.bodies.values())
    image = None
    for name, body in section.bodies.items():
        size = 1e6 * np.hypot(body.right, body.up)
        for side in (1, -1):
            x, z = 1e3 * side * (body.x + scale * body.right), 1e3 * (body.z + scale * body.up)
            image = axes.pcolormesh(x, z, size, shading="gouraud", cmap="viridis", vmin=0, vmax=1e6 * largest)
            axes.plot(*_outline(x, z), color="k", lw=0.8)
            axes.plot(*_outline(1e3 * side * body.x, 1e3 * body.z), color="0.5", lw=0.6, ls="--")
        if name in ("object", "ring", "tooth"):
            middle = 1e3 * float(body.x.min() + body.x.max()) / 2 if name == "ring" else 0.0
            axes.annotate(
                name, (middle, 1e3 * float(body.z.min() + body.z.max()) / 2), ha="center", va="center", color="w"
            )
    assert image is not None
    axes.figure.colorbar(image, ax=axes, label="displacement for 1 N (µm)", shrink=0.8)
    modulus = show(picture.answers[0].sensed_modulus, "Pa")
    axes.set(aspect="equal", xlabel="radius (mm)", ylabel="height (mm)")
    axes.set_title(f"deformed, displacements × {scale:g}: object of {modulus}", fontsize=10)


def _outline(x: Array, z: Array) -> tuple[Array, Array]:
    return tuple(np.concatenate([v[:, 0], v[-1], v[::-1, -1], v[0, ::-1]]) for v in (x, z))  # type: ignore[return-value]


def _draw_pressure(picture: Picture, axes: Axes) -> None:
    seen: list[float] = []
    for answer, section in zip(picture.answers, picture.sections, strict=True):
        ratio = answer.response.force_ratio
        label = f"{show(answer.sensed_modulus, 'Pa')}: tooth takes {100 * ratio:.1f} %"
        gaps = np.where(section.pressure > 0, section.pressure, np.nan) / 1e3
        at = np.searchsorted(section.x, section.tooth)
        axes.plot(*(np.insert(v, at, np.nan) for v in (1e3 * section.x, gaps)), lw=1.2, label=label)
        ends = [section.tooth, *section.x[[at, -1]]]
        clear = np.min([np.abs(section.x - end) for end in ends], axis=0) > EDGE * section.tooth
        seen += gaps[clear & np.isfinite(gaps)].tolist()
    section = picture.sections[0]
    axes.axvspan(0, 1e3 * section.tooth, color="C7", alpha=0.2, lw=0)
    axes.axhline(section.mean / 1e3, color="k", lw=0.8, ls="--", label="mean over the object")
    axes.set(
        yscale="log", xlim=(0, None), ylim=(min(seen) / 2, max(seen) * 3),
        xlabel="radius (mm); shaded: tooth", ylabel="pressure on the sensor's face for 1 N (kPa)",
    )  # fmt: skip
    axes.set_title("singular at edges, and clipped there; tension is not shown", fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def _draw_ratio(picture: Picture, axes: Axes) -> None:
    for name, (moduli, ratios) in picture.curves.items():
        axes.plot(moduli / 1e3, ratios, lw=1.2, label=name)
    axes.plot(
        [answer.sensed_modulus / 1e3 for answer in picture.answers],
        [answer.response.force_ratio for answer in picture.answers],
        "ko", ms=5, label=f"{picture.question.model}, as asked",
    )  # fmt: skip
    if picture.measured:
        moduli, ratios = np.array(list(picture.measured.values())).T
        axes.plot(moduli / 1e3, ratios, "r^", ms=5, mfc="none", label="thesis, measured means")
    axes.set(
        xscale="log",
        ylim=(0, 1),
        xlabel="Young modulus of the sensed object (kPa)",
        ylabel="force ratio, tooth over all",
    )
    axes.set_title("force ratio", fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
