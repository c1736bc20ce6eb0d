"""Table A2.7: a point load moves along the length of the common base."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np

from palpate.instrument.models.parameters import SolidParameters, get_parameter_set, solid_parameters
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.thesis import read_table
from palpate.procedures.reproduce.chapter4.theory import table_ratio
from palpate.procedures.reproduce.curves import BASE, COARSE_MESH, RING, TOOTH, Curves, film_voltages
from palpate.procedures.reproduce.judging.rows import Comparison, column_of, fit_sentence

MODEL = "solid"
# Modulus of the object, which the table does not tell: with it Table A2.3 has the ratio that A2.7 has beside the teeth.
MODULUS = 430e3
# Modulus of set `capped`, fitted with the rest of the set: 4.5 times the ring's.
CAPPED, CAPPED_MODULUS = "capped", 4.5 * RING
GOAL = 0.04  # N of 1 N: the fit of the cap reaches it; all sets are compared with it


def sets(parameters: Sequence[str]) -> tuple[str, ...]:
    """Parameter sets of this table: with "identified" also `capped`, which was fitted to this table alone."""
    return (*parameters, CAPPED) if "identified" in parameters else tuple(parameters)


def compare(parameters: Sequence[str], curves: Curves) -> Comparison:
    """Table A2.7 on the coarsest mesh, which is within 4e-3 N of the next finer one (set `capped`: 0.02 N)."""
    table = read_table("A2.7")
    x = 1e-3 * table.keys()
    forces = {}
    for name in sets(parameters):
        chosen = get_parameter_set(name, MODEL)
        sensor = chosen.design(get_design("common_base"))
        places = [(float(place), sensor.cell[1] / 2) for place in x]
        asked = solid_parameters(sensor, chosen.load(CAPPED_MODULUS if name == CAPPED else MODULUS))
        solved = curves.solutions.of(
            asked,
            f"mesh {COARSE_MESH}, point loads at {places}",
            functools.partial(_solve, asked, places),
        )
        forces[name, MODEL] = np.reshape(solved, (len(places), len(sensor.teeth)))
        curves.step(f"common_base under a point load, {name}")
    left, right = ({key: teeth[:, tooth] for key, teeth in forces.items()} for tooth in (0, 1))
    none = np.zeros(len(x))

    def volts(film: str, force: np.ndarray) -> np.ndarray:
        return film_voltages(get_design("common_base"), film, force, none, none)

    columns = (
        column_of(table, "force_pvdf3_N", left, GOAL),
        column_of(table, "force_pvdf1_N", right, GOAL),
        column_of(table, "force_ratio", {key: teeth.sum(axis=1) for key, teeth in forces.items()}, GOAL),
        column_of(table, "voltage_pvdf3_V", {key: volts(TOOTH, force) for key, force in left.items()}),
        column_of(table, "voltage_pvdf1_V", {key: volts(TOOTH, force) for key, force in right.items()}),
        column_of(table, "voltage_pvdf2_V", {key: volts(BASE, none + 1) for key in left}),
    )
    comparison = Comparison(table, columns, ())
    thesis = table.values("force_pvdf3_N")
    middle, above, edge = len(x) // 2, int(np.argmax(thesis)), 0
    said = [
        f"the object's modulus is not printed: {MODULUS / 1e3:g} kPa is taken, at which Table A2.3 has the force"
        f" ratio {_at_modulus():.4f}; A2.7 has {table.values('force_ratio')[middle]:.4f} between the teeth",
        *(fit_sentence(comparison, quantity) for quantity in ("force_pvdf3_N", "force_pvdf1_N", "force_ratio")),
    ]
    for (name, _), force in left.items():
        said.append(
            f"left tooth, {name} set: between the teeth {force[middle]:.3f} N (thesis {thesis[middle]:.3f}), above the"
            f" tooth {force[above]:.3f} N (thesis {thesis[above]:.3f}), at the edge {force[edge]:.3f} N (thesis"
            f" {thesis[edge]:.3f}), least {force.min():.3f} N (thesis {thesis.min():.5f})"
        )
    over = ", ".join(f"{name} set {_span(force)}" for (name, _), force in left.items())
    said.append(
        f"the thesis' force hardly depends on the place of a load beside a tooth ({_span(thesis)} over 3 mm; {over}),"
        " as where the ring's top stays level. Below zero, our model holds the contact where it would lift off"
    )
    if CAPPED in sets(parameters):
        said.append(
            "the capped set is a fit to this table: a rigid cap that keeps each ring's top level, Poisson ratios 0.3,"
            f" an object of 0.8 mm and {CAPPED_MODULUS / 1e3:g} kPa. At that modulus Table A2.3 has the force ratio"
            f" {table_ratio('A2.3', np.array([CAPPED_MODULUS]))[0]:.3f}: the two tables are not of one object"
        )
    return Comparison(table, columns, tuple(said))


def _span(forces: np.ndarray) -> str:
    """Least and greatest force under loads beside the left tooth and its gap."""
    beside = forces[[0, 1, 3]]
    return f"{beside.min():.4f} to {beside.max():.4f} N"


def _solve(asked: SolidParameters, places: list[tuple[float, float]]) -> list[float]:
    from palpate.instrument.models.solid.model import point_loads

    return list(point_loads(asked, places, COARSE_MESH).ravel())


def _at_modulus() -> float:
    table = read_table("A2.3")
    return float(abs(table.values("force_ratio"))[table.keys() == MODULUS][0])
