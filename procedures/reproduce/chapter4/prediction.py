"""Predictions for one ring by a parameter set that was fitted to the other ring, and how far off they are."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.evidence import OTHER_RING, REPEATS, Evidence
from palpate.instrument.models.parameters import get_parameter_set
from palpate.instrument.thesis import read_table
from palpate.procedures.reproduce.curves import RING, ring_of
from palpate.procedures.reproduce.judging.rows import ComparedColumn, Comparison

Array = NDArray[np.float64]

NEWTONS_PER_VOLT = 1000.0  # force over voltage of the tooth's film in Tables A2.1 and A2.2, within 0.2 %


def prediction_sentences(comparison: Comparison, quantity: str, film: str | None = None) -> Iterator[str]:
    """Sentences on each fitted set and model for which the table is a prediction; none where it is not.

    Args:
        comparison: the table.
        quantity: column of the force ratio, or of the tooth's force under 1 N.
        film: column of the tooth film's voltages, which also tell the force; None: there is none.
    """
    table, moduli = comparison.table, comparison.table.keys()
    columns = {column.quantity: column for column in comparison.columns}
    column, ring = columns[quantity], ring_of(table)
    if ring == RING:
        return
    for series in column.ours:
        chosen = get_parameter_set(series.parameters, series.model)
        if chosen.fitted_to and column.evidence(series, table) is Evidence.PREDICTED:
            said = (
                f"{series.parameters} set by {series.model}: fitted on the ring of {RING / 1e3:g} kPa and predicted"
                f" here, off by {_softer_and_harder(column.difference(series), moduli, ring)}"
            )
            yield said + (_by_film(columns[film], series.values, moduli, ring) if film is not None else "")
    yield _scaled(column, REPEATS.get(table.number, table.number), moduli, ring)


def _softer_and_harder(difference: Array, moduli: Array, ring: float) -> str:
    """Text of the greatest difference for objects softer than the ring, and for the others."""
    parts = []
    for which, here in (("softer than the ring", moduli < ring), ("harder", moduli >= ring)):
        worst = int(np.argmax(np.where(here, np.abs(difference), -1.0)))
        parts.append(f"at most {abs(difference[worst]):.4f} where the object is {which} (at {moduli[worst]:g} Pa)")
    return ", ".join(parts)


def _by_film(column: ComparedColumn, ratio: Array, moduli: Array, ring: float) -> str:
    """Text of the same against printed voltages, with each repaired one that is farther off than all others."""
    difference = ratio - NEWTONS_PER_VOLT * np.array([abs(float(cell.printed)) for cell in column.cells])
    sound = np.array([not cell.reason for cell in column.cells])
    most = np.abs(difference[sound & (moduli >= ring)]).max()
    doubtful = [
        f"{off:+.4f} at {modulus:g} Pa"
        for off, modulus in zip(difference[~sound], moduli[~sound], strict=True)
        if abs(off) > most
    ]
    return (
        f"; by the printed voltages of its film at {NEWTONS_PER_VOLT:g} N/V"
        f" {_softer_and_harder(difference[sound], moduli[sound], ring)}"
        + (f"; beside cells that are doubtful: {', '.join(doubtful)}" if doubtful else "")
    )


def _scaled(column: ComparedColumn, number: str, moduli: Array, ring: float) -> str:
    """Text that tells how well the thesis' own table of the other ring predicts this one."""
    other = read_table(OTHER_RING[number])
    name = "force_ratio" if "force_ratio" in other.columns else "force_rigid_N"
    ratio, softer = abs(other.values(name)), moduli * RING / ring
    inside = softer >= other.keys()[0]
    odds = np.interp(softer[inside], other.keys(), ratio / (1 - ratio))  # the odds are a straight line in the modulus
    off = float(np.abs(odds / (1 + odds) - column.thesis[inside]).max())
    return (
        f"Table {other.number} at the same ratio of moduli has this column within {off:.4f}: both rings lie on one"
        " curve, so on a rigid support a set that meets one meets the other, and is tested anew only for objects below"
        f" {moduli[inside][0] / 1e3:g} kPa"
    )
