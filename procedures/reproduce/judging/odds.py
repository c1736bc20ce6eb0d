"""The law of the thesis' three-dimensional tables: tooth force over ring force is a straight line in the modulus."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.springs import LINES, OddsLine
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.thesis import ThesisTable
from palpate.procedures.reproduce.curves import RING, ring_of

Array = NDArray[np.float64]

STEPS = 20  # of Gauss and Newton; five would suffice


def fitted_line(table: ThesisTable) -> OddsLine:
    """Line by least squares over the unrepaired force ratios of a table; `residual` is over all its cells."""
    places, ratios, sound = _cells(table)
    x, ratio = places[sound], ratios[sound]
    start, slope = 0.1, 0.1
    for _ in range(STEPS):
        odds = start + slope * x
        weight = 1 / (1 + odds) ** 2  # change of the ratio by one of the odds
        change, *_ = np.linalg.lstsq(
            weight[:, None] * np.stack([np.ones_like(x), x], axis=1), ratio - odds / (1 + odds), rcond=None
        )
        start, slope = max(start + change[0], 1e-6), max(slope + change[1], 1e-6)
    return OddsLine(float(start), float(slope), distance(OddsLine(float(start), float(slope), 0.0), table))


def distance(line: OddsLine, table: ThesisTable) -> float:
    """Greatest difference of the line's force ratio from a table's."""
    places, ratios, _ = _cells(table)
    return float(np.abs([line.force_ratio(place) for place in places] - ratios).max())


def odds_sentence(table: ThesisTable, design: str) -> str:
    """Sentence that tells how well a table keeps the law, by a line of its own and by model `column_fitted`.

    For the long table of the softer ring, with which the experiments were done, it also tells what the law means for
    them.
    """
    own, softer = fitted_line(table), ring_of(table) == RING
    worth = "fitted to this ring" if softer else "fitted on the other ring, a prediction on this one"
    said = (
        f"odds of tooth to ring R/(1-R) are {own.start:.5f} + {own.slope:.6f} E1/E2, to {own.residual:.1e} of R at"
        f" worst; by model column_fitted, {worth}, to {distance(LINES[design], table):.1e}"
    )
    if not (softer and table.number.startswith("A")):
        return said
    low, high = moduli_of_experiments(design)
    return (
        f"{said}. So two springs, the object over the tooth and the object in series with the ring, do what the thesis'"
        " finite elements do. By the inverse the experiments' mean ratios are those of objects"
        f" {low:.2f} to {high:.2f} times as hard as the samples"
    )


def moduli_of_experiments(design: str) -> tuple[float, float]:
    """Moduli by the line from the experiments' mean ratios, over the samples' moduli: least and greatest."""
    known = get_design(design)
    shares = [
        LINES[design].modulus_ratio(ratio) * known.ring.material.modulus / get_sample(name).modulus
        for name, ratio in known.thesis_force_ratio.items()
    ]
    return min(shares), max(shares)


def _cells(table: ThesisTable) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Ratios of moduli, force ratios, and whether each of these is as printed."""
    column = table.columns["force_ratio" if "force_ratio" in table.columns else "force_rigid_N"]
    ratios = np.array([abs(cell.value) for cell in column])
    return table.keys() / ring_of(table), ratios, np.array([not cell.reason for cell in column])
