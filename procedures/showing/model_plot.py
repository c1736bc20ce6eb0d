"""Draws a sensor under load: the deformed section, the pressure on its face, the force ratio over the modulus."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import UsageError
from palpate.instrument.quantity import show
from palpate.procedures.records.run import storing
from palpate.procedures.showing.figure import write
from palpate.procedures.showing.model_picture import ModelPicture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from palpate.instrument.models.table import Response

Array = NDArray[np.float64]

EDGE = 0.05  # fraction of a tooth's width; closer to an edge the singular pressure does not count for the scale
LABELLED = ("object", "ring", "tooth")  # bodies that are thick enough for their names
THESIS_STYLES = ("k.", "r^")


def place(subject: str, out: Path | None, store: Path) -> Path:
    """Path of a new picture: `out`, or a file in `plots/` of the store, named after time and subject.

    Raises:
        UsageError: the name does not end in .png, its folder does not exist, or the file exists.
        RecordError: the store cannot be written to.
    """
    if out is None:
        out = store / "plots" / f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{subject}.png"
        with storing(out):
            out.parent.mkdir(parents=True, exist_ok=True)
    if out.suffix != ".png":
        raise UsageError(f"{out} does not end in .png, the only format; choose another --out")
    with storing(out):
        if not out.parent.is_dir():
            raise UsageError(f"{out}: there is no folder {out.parent}; make it, or choose another --out")
        if out.exists():
            raise UsageError(f"{out} exists and is not overwritten; choose another --out")
    return out.absolute()


def draw(picture: ModelPicture, file: Path) -> None:
    """Draw a picture into a PNG file.

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
    axes.legend(fontsize=8)


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
    axes.legend(fontsize=8)
