"""The round sensor by CalculiX: quadratic axisymmetric elements on our own graded grid, halved as often as asked."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric.mesh import Grid, grid, inside
from palpate.instrument.models.parameters import RoundParameters

Array = NDArray[np.float64]

PROGRAM = "ccx"


def axisymmetric_ratio(parameters: RoundParameters, layers: int, halvings: int) -> float:
    """Force ratio of a bonded sensor on elastic plates; tooth force from the mean stress of the tooth."""
    cut = _halve(grid(parameters, layers), halvings)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "sensor.inp").write_text(_deck(parameters, cut))
        subprocess.run([PROGRAM, "sensor"], cwd=folder, stdout=subprocess.DEVNULL, check=True)
        lines = Path(folder, "sensor.dat").read_text().splitlines()
    printed = np.array(
        [[float(value) for value in line.split()] for line in lines if line[:1] == " " and line.split()[0].isdigit()]
    )
    return _tooth_force(parameters, cut, printed)


def _halve(coarse: Grid, halvings: int) -> Grid:
    parts = np.linspace(0, 1, 2**halvings, endpoint=False)

    def cut(lines: Array) -> Array:
        return np.append((lines[:-1, None] + np.diff(lines)[:, None] * parts).ravel(), lines[-1])

    return Grid(coarse.bodies, cut(coarse.radii), cut(coarse.heights), coarse.face, coarse.base)


def _cells(cut: Grid) -> list[list[tuple[int, int]]]:
    """Columns and rows of each body."""
    return [
        [(int(i), int(j)) for i in inside(cut.radii, body.radii) for j in inside(cut.heights, body.heights)]
        for body in cut.bodies
    ]


def _deck(parameters: RoundParameters, cut: Grid) -> str:
    """Nodes lie on a lattice of half the grid's steps; millimetres, newtons, megapascals."""
    radii, heights = (
        1e3 * np.interp(np.arange(0, len(x) - 0.5, 0.5), np.arange(len(x)), x) for x in (cut.radii, cut.heights)
    )
    wide = len(radii)
    used: set[int] = set()
    bodies, materials, number = [], [], 0
    pressure = []
    load = -1 / (np.pi * (1e3 * parameters.sensed_radius) ** 2)
    for body, cells in zip(cut.bodies, _cells(cut), strict=True):
        name = body.name.replace(" ", "_").upper()
        lines = [f"*ELEMENT, TYPE=CAX8R, ELSET={name}"]
        for i, j in cells:
            number += 1
            at = [
                1 + 2 * i + di + wide * (2 * j + dj)
                for di, dj in ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
            ]
            used.update(at)
            lines.append(f"{number}, " + ", ".join(map(str, at)))
            if body.name == "object" and j == len(cut.heights) - 2:
                pressure.append(f"{number}, P3, {-load:.16g}")
        bodies.append("\n".join(lines))
        materials.append(
            f"*MATERIAL, NAME={name}\n*ELASTIC\n{1e-6 * body.modulus:.16g}, {body.poisson:.16g}\n"
            f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"
        )
    nodes = [f"{n}, {radii[(n - 1) % wide]:.16g}, {heights[(n - 1) // wide]:.16g}" for n in sorted(used)]
    axis = [f"{n}, 1" for n in sorted(used) if (n - 1) % wide == 0]
    floor = [f"{n}, 1, 2" for n in sorted(used) if n <= wide]
    step = ["*STEP", "*STATIC", "*DLOAD", *pressure, "*EL PRINT, ELSET=TOOTH", "S", "*END STEP", ""]
    return "\n".join(["*NODE, NSET=ALL", *nodes, *bodies, *materials, "*BOUNDARY", *axis, *floor, *step])


def _tooth_force(parameters: RoundParameters, cut: Grid, printed: Array) -> float:
    """Mean axial stress of the tooth over its volume, from the integration points of its elements."""
    index = next(k for k, body in enumerate(cut.bodies) if body.name == "tooth")
    first = 1 + sum(len(cells) for cells in _cells(cut)[:index])
    i, j = np.array(_cells(cut)[index]).T
    element, point = printed[:, 0].astype(int) - first, printed[:, 1].astype(int) - 1
    a, b = cut.radii[i][element], cut.radii[i + 1][element]
    # Eight points of the brick that an element is swept to: the radial coordinate runs fastest.
    radius = (a + b) / 2 + np.where(point % 2, 1, -1) * (b - a) / 2 / np.sqrt(3)
    weight = radius * (b - a) * np.diff(cut.heights)[j][element]
    mean = float((printed[:, 3] * weight).sum() / weight.sum())
    return -mean * np.pi * (1e3 * parameters.tooth_radius) ** 2
