"""A sentence on the thesis' film voltages: their scale is wrong, and they are linear in the force."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.sensor.design import Design
from palpate.instrument.thesis import ThesisTable
from palpate.procedures.reproduce.curves import TOOTH

Array = NDArray[np.float64]

G33 = 0.15  # V m/N, Table 3.2, as a magnitude


def voltage_sentence(
    table: ThesisTable, column: str, force: Array, sensor: Design, film: str, ours: dict[str, Array]
) -> str:
    """Sentence that compares voltage over force of the thesis, of g33 t / A, and of our models.

    Args:
        table: table of the thesis.
        column: name of its column of voltages [V].
        force: the thesis' force on the film in each row [N].
        sensor: the design.
        film: "tooth" or "base".
        ours: voltage over force in each row [V/N], by the name of the model.
    """
    thesis = np.abs(table.values(column)) / force
    kind = "rigid" if film == TOOTH else "total"
    area = sensor.film_area(next(f for f in sensor.films if f.kind == kind))
    expected = G33 * sensor.film_sheet.thickness / area
    models = ", ".join(f"{_range(values)} V/N by the {name}" for name, values in ours.items())
    return (
        f"{column}: {_range(1e3 * thesis)} mV/N at every modulus, linear in the force. Open-circuit g33 t / A is"
        f" {expected:.3g} V/N, {expected / np.median(thesis):.0f} times more: the thesis does not say why, and"
        f" the voltages' scale is not comparable. The coupled film model gives {models}"
    )


def _range(values: Array) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{high:.3g}" if high - low < 1e-3 * high else f"{low:.4g} to {high:.4g}"
