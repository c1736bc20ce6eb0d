"""Classes of a load cell by ISO 376 and ASTM E74, from runs of dead weights that are put on and taken off again.

Figures and limits after ISO 376:2011 (Table 2) and ASTM E74-18.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import ConfigDict

from palpate.instrument.arrays import Floats
from palpate.instrument.config import Config
from palpate.instrument.uncertainty.interpolation import Interpolation, interpolate

NOT_CLASSIFIABLE = "not classifiable"

ASTM_E74_FACTORS = {"AA": 2000.0, "A": 400.0}  # the range of a class begins at this multiple of the lower limit factor
ASTM_E74_SIGMAS = 2.4
ASTM_E74_LOADS, ASTM_E74_READINGS = 10, 30
ISO_376_LOADS = 8
ISO_376_PART = 0.5  # the range of a class must begin at this share of the greatest load, or below


@dataclass(frozen=True, slots=True)
class WeightRun:
    """One run of weights that are put on one after the other and taken off again.

    Args:
        position: angle of the cell about its axis [degrees].
        loading_mV, unloading_mV: (k,) readings, both at increasing loads.
        zero_before_mV, zero_after_mV: readings of the unloaded cell; None: not read.
        repeats: number of displayed values whose mean is one reading.
        scatter_mV: standard deviation of a single displayed value about such a mean; None: not known.
    """

    position: float
    loading_mV: Floats
    unloading_mV: Floats
    zero_before_mV: float | None = None
    zero_after_mV: float | None = None
    repeats: int = 1
    scatter_mV: float | None = None

    def mean_mV(self) -> Floats:
        """Mean (k,) of the readings of loading and unloading."""
        mean: Floats = 0.5 * (self.loading_mV + self.unloading_mV)
        return mean


class Classification(Config):
    """The class of a load cell and the loads over which it holds. Where there is none, `reason` says why."""

    model_config = ConfigDict(strict=True)

    name: str
    least_N: float | None = None
    greatest_N: float | None = None
    reason: str = ""


Quantities = dict[str, Floats | None]
"""Quantities of ISO 376 by name: fractions (k,) at the loads; None: the runs do not determine it.

    reproducibility  b: spread of the first runs in several positions over their mean
    repeatability    b': greatest spread of the runs in one position over their mean
    interpolation    fc: size of the deviation of the mean deflection from the curve
    reversibility    v: unloading less loading over loading, in size, mean of the runs
    zero_return      f0: greatest change of the zero over a run, over the greatest deflection
    creep            c: change of the reading from 30 s to 300 s under the greatest load, over its deflection
    resolution       r: a step of the indicator over the deflection
"""

_ORDER = ("reproducibility", "repeatability", "interpolation", "reversibility", "zero_return", "creep", "resolution")

ISO_376: dict[str, dict[str, float]] = {
    "00": dict(zip(_ORDER, (5e-4, 2.5e-4, 2.5e-4, 7e-4, 1.2e-4, 2.5e-4, 1 / 4000), strict=True)),
    "0.5": dict(zip(_ORDER, (1e-3, 5e-4, 5e-4, 1.5e-3, 2.5e-4, 5e-4, 1 / 2000), strict=True)),
    "1": dict(zip(_ORDER, (2e-3, 1e-3, 1e-3, 3e-3, 5e-4, 1e-3, 1 / 1000), strict=True)),
    "2": dict(zip(_ORDER, (4e-3, 2e-3, 2e-3, 5e-3, 1e-3, 2e-3, 1 / 500), strict=True)),
}
"""Greatest value of each quantity in each class, from the best class to the worst."""

MAY_BE_MISSING = ("creep",)  # ISO 376 accepts the reversibility instead of it


def quantities(
    load: Floats, runs: Sequence[WeightRun], curve: Interpolation, resolution_mV: float, creep_mV: float | None
) -> Quantities:
    """Quantities of ISO 376 from runs of dead weights.

    Args:
        load: (k,) N, increasing.
        curve: curve through the mean readings.
        creep_mV: change of the reading from 30 s to 300 s under the greatest load; None: not measured.
    """
    zero = float(curve.coefficients[0])
    up = np.array([run.loading_mV - _zero(run, zero) for run in runs])
    down = np.array([run.unloading_mV - _zero(run, zero) for run in runs])
    groups = by_position(runs, up)
    first = np.array([own[0] for own in groups])
    repeated = [own for own in groups if len(own) > 1]
    fitted = curve.reading(load) - zero
    mean = np.mean([run.mean_mV() for run in runs], axis=0) - zero
    returns = [
        abs(run.zero_after_mV - run.zero_before_mV)
        for run in runs
        if run.zero_after_mV is not None and run.zero_before_mV is not None
    ]
    greatest, all_loads = abs(float(fitted[-1])), np.ones(load.size)
    return {
        "reproducibility": _spread(first) if len(first) > 1 else None,
        "repeatability": np.max([_spread(own) for own in repeated], axis=0) if repeated else None,
        "interpolation": np.abs(mean / fitted - 1),
        "reversibility": np.mean(np.abs(down / up - 1), axis=0),
        "zero_return": max(returns) / greatest * all_loads if returns else None,
        "creep": None if creep_mV is None else abs(creep_mV) / greatest * all_loads,
        "resolution": resolution_mV / np.abs(fitted),
    }


def spread_over_positions(load: Floats, runs: Sequence[WeightRun]) -> float:
    """Standard deviation [mV/N] of the slopes of straight lines over the positions of the cell; 0 for one position."""
    groups = by_position(runs, np.array([run.mean_mV() for run in runs]))
    if len(groups) == 1:
        return 0.0
    return float(np.std([interpolate(load, own.mean(axis=0), 0.0).coefficients[1] for own in groups], ddof=1))


def by_position(runs: Sequence[WeightRun], values: Floats) -> list[Floats]:
    """Rows of values (runs, k), grouped by the position of the cell in their runs, in the order of the runs."""
    positions = [run.position for run in runs]
    return [values[[p == position for p in positions]] for position in dict.fromkeys(positions)]


def _zero(run: WeightRun, fitted: float) -> float:
    return fitted if run.zero_before_mV is None else run.zero_before_mV


def _spread(deflections: Floats) -> Floats:
    spread: Floats = np.ptp(deflections, axis=0) / np.abs(deflections.mean(axis=0))
    return spread


def classify_iso_376(load: Floats, found: Quantities) -> Classification:
    """The best class that holds from some load to the greatest one, and at least down to half of it."""
    if reasons := short_of_iso_376(load, found, "2"):
        return _none(*reasons)
    name = next(name for name in ISO_376 if not short_of_iso_376(load, found, name))
    good = np.all([values <= ISO_376[name][key] for key, values in found.items() if values is not None], axis=0)
    first = int(np.flatnonzero(~good).max(initial=-1)) + 1
    return Classification(name=name, least_N=float(load[first]), greatest_N=float(load[-1]))


def short_of_iso_376(load: Floats, found: Quantities, name: str) -> list[str]:
    """Why runs do not give a class: what they lack, and the quantities above its limits; empty: they do."""
    missing = [key for key, values in found.items() if values is None and key not in MAY_BE_MISSING]
    reasons = lacking_for_iso_376(load, missing)
    must = max(int((load <= ISO_376_PART * load[-1]).sum()) - 1, 0)  # from here a class holds at the latest
    for key, values in found.items():
        if values is None:
            continue
        worst, limit = float(values[must:].max()), ISO_376[name][key]
        if not worst <= limit:  # NaN is no class
            reasons.append(
                f"{key.replace('_', ' ')} {100 * worst:.3g} % from {load[must]:.4g} N on exceeds the "
                f"{100 * limit:.3g} % of ISO 376 class {name}"
            )
    return reasons


def lacking_for_iso_376(load: Floats, missing: Sequence[str]) -> list[str]:
    """What loads and runs lack for any class; `missing`: quantities that the runs do not tell."""
    reasons = []
    if load.size < ISO_376_LOADS:
        reasons.append(f"ISO 376 asks for {ISO_376_LOADS} loads, not {load.size}")
    if load[0] > ISO_376_PART * load[-1]:
        reasons.append(f"ISO 376 asks for loads down to {ISO_376_PART:.0%} of the greatest")
    if missing:
        reasons.append(f"ISO 376 asks for {' and '.join(missing)}, which the runs do not tell")
    return reasons


def iso_376_class_of(key: str, worst: float) -> str:
    """The class that one quantity meets, given its greatest value."""
    return next((name for name, limits in ISO_376.items() if worst <= limits[key]), NOT_CLASSIFIABLE)


def lower_limit_factor(load: Floats, runs: Sequence[WeightRun], curve: Interpolation) -> float:
    """LLF of ASTM E74 [N]: 2.4 standard deviations of the single readings about the curve.

    Their degrees of freedom are readings less coefficients. Dividing by one degree more, as some do, gives 0.096 N
    instead of 0.100 N for the thesis' cell.
    """
    fitted = curve.reading(load)
    residual = np.concatenate([series - fitted for run in runs for series in (run.loading_mV, run.unloading_mV)])
    s = float(np.linalg.norm(residual)) / math.sqrt(residual.size - curve.coefficients.size)
    return ASTM_E74_SIGMAS * s / abs(float(curve.coefficients[1]))


def classify_astm_e74(load: Floats, readings: int, factor: float, resolution: float) -> Classification:
    """Class AA or A of ASTM E74, with the range of loads over which it holds.

    Args:
        load: (k,) N, increasing.
        readings: number of readings under load, in all runs.
        factor: lower limit factor [N]; at least the resolution is used.
        resolution: load of one step of the indicator [N].
    """
    counted = max(factor, resolution)
    for name, times in ASTM_E74_FACTORS.items():
        least = max(times * counted, float(load[0]))
        if least <= load[-1]:
            few = _few(load.size, readings)
            return _none(*few) if few else Classification(name=name, least_N=least, greatest_N=float(load[-1]))
    least = ASTM_E74_FACTORS["A"] * counted
    return _none(
        f"ASTM E74 class A begins at {ASTM_E74_FACTORS['A']:g} x {counted:.3g} N = {least:.3g} N, above the greatest "
        f"load of {load[-1]:.3g} N",
        *_few(load.size, readings),
    )


def _few(loads: int, readings: int) -> list[str]:
    if loads >= ASTM_E74_LOADS and readings >= ASTM_E74_READINGS:
        return []
    return [f"ASTM E74 asks for {ASTM_E74_READINGS} readings at {ASTM_E74_LOADS} loads, not {readings} at {loads}"]


def _none(*reasons: str) -> Classification:
    return Classification(name=NOT_CLASSIFIABLE, reason="; ".join(reasons))
