"""What points under dynamic loads are expected to give, before anything moves: noise of films, readings of loads.

Assumed [A] is the noise of the load's display, and that of films where none is stated (`noise_of`). The load cell of
the thesis [M] stands for one that is not known, because its bench is not open yet.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from palpate.instrument.allocation.lines import BudgetLine, Costs
from palpate.instrument.allocation.repeated import Repeated, planned
from palpate.instrument.allocation.table import MOST_SETS, Allocation, RunOption, dwells
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import calibration_u, mean_ratio, pickup_u
from palpate.instrument.models.springs import force_ratio
from palpate.instrument.quantity import as_typed, rounded_up, show
from palpate.instrument.sensor.design import FILM_KINDS, Design, Film
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.dwell import STEP, whole_steps
from palpate.instrument.uncertainty.budget import Budget, mean_u
from palpate.procedures.engine.plan import expected_noise
from palpate.procedures.lab.calibrations import probable_load_cell
from palpate.procedures.lab.lab import Target
from palpate.procedures.steps.servo import READINGS

DISPLAY_NOISE = 0.3  # of the indicator's step: standard deviation of a reading before it is rounded [A]


@dataclass(frozen=True, slots=True)
class ExpectedPoint:
    """What is expected of a point of which the force ratio is sought, as `mean_ratio` takes it."""

    force_ratio: float
    force_ratio_u: float
    noise_u: float
    calibration_u: float
    pickup_u: float
    degrees_of_freedom: float | None = None


def expected_mean(
    quantity: str, design: Design, ratio: float, loads: Sequence[float], dwells: Sequence[float]
) -> Budget:
    """The budget that is expected of a mean force ratio.

    Args:
        quantity: name of the mean.
        design: design of the sensor, with the calibration of its films.
        ratio: the expected force ratio.
        loads: load of each point, peak to peak [N].
        dwells: dwell of each point [s].
    """
    films, pickup = ratio * calibration_u(design), pickup_u(design) * math.hypot(ratio, 1.0)
    points = []
    for load, dwell in zip(loads, dwells, strict=True):
        noise = ratio * expected_noise(design, load, ratio) / math.sqrt(dwell)
        u = math.hypot(ratio * design.ratio_scatter, noise, films, pickup)
        points.append(ExpectedPoint(ratio, u, noise, films, pickup))
    return mean_ratio(quantity, points, design.film_freedom)


def expected_ratio(design: Design, sample: str) -> float:
    """The force ratio to be expected of a sample: the thesis' mean, or that of a simple model."""
    return design.thesis_force_ratio.get(sample) or force_ratio(design, get_sample(sample))


def load_cell_of(target: Target) -> LoadCellCalibration:
    """Calibration of the target's load cell; that of the thesis, if the bench is not open yet."""
    return target.load_cell or THESIS_LOAD_CELL


def probable_cell_of(target: Target) -> LoadCellCalibration:
    """As `load_cell_of`, but before the bench is open it is the calibration that it probably has, if one is stored."""
    return target.load_cell or probable_load_cell(target.scene) or THESIS_LOAD_CELL


def reading_u(cell: LoadCellCalibration, load: float) -> float:
    """Relative standard uncertainty of a measured load [N, peak to peak] without that of the load cell's curve."""
    return cell.reading_u(READINGS) / cell.sensitivity_mV_per_N / load


def display_u(cell: LoadCellCalibration, readings: int) -> float:
    """Expected standard uncertainty [mV] of the mean of so many displayed values, whose scatter a run tells."""
    return mean_u(display_scatter(cell), cell.resolution_mV, readings)


def display_scatter(cell: LoadCellCalibration) -> float:
    """Expected standard deviation of single displayed values about their mean [mV].

    It is that of the cell's calibration; where that does not tell it, DISPLAY_NOISE is assumed.
    """
    if cell.scatter_mV is not None:
        return cell.scatter_mV
    return cell.resolution_mV * math.sqrt(DISPLAY_NOISE**2 + 1 / 12)


def load_on(design: Design, film: Film, ratio: float, load: float) -> float:
    """Force on a film under a load on the whole sensor [N, peak to peak], if all teeth bear alike."""
    share = ratio if film.kind == FILM_KINDS[0] else 1.0
    return share * load * len(film.teeth) / len(design.teeth)


def film_noise(film: Film, force: float, dwell: float, density: float) -> float:
    """Expected relative standard uncertainty of a film's amplitude by noise.

    Args:
        film: the film.
        force: force on it, peak to peak [N].
        dwell: dwell [s].
        density: amplitude density of the noise [V/√Hz].
    """
    return density / (film.sensitivity * force / 2) / math.sqrt(dwell)


# -------------------------------------------------------------------------------------------------------
# Load sets that are repeated for a tolerance: the plans, their refusal, and the most sets that a run takes

Name = TypeVar("Name")


def options(lines: Sequence[BudgetLine], costs: Costs, frequency: float) -> list[RunOption]:
    """The ways of a run at a frequency [Hz], with dwells in whole steps."""
    shortest = whole_steps(max(STEP, 1 / frequency))
    return [RunOption(lines, costs, dwell) for dwell in dwells(lines, shortest, whole_steps)]


def repeated(
    ways: Mapping[Name, Sequence[RunOption]],
    tolerance: float,
    rounds: int,
    of: str,
    remedies: Mapping[str, Sequence[str]],
) -> dict[Name, Repeated]:
    """The load sets of each thing for a tolerance.

    Args:
        ways: ways of each thing.
        tolerance: the tolerance.
        rounds: number of sets of a round.
        of: of what the tolerance is, for people; {} stands for the thing.
        remedies: what would lower a line that binds, by its name.

    Raises:
        RangeError: no number of sets of some thing reaches it; the message says what binds and what would do.
    """
    found, refused = planned(ways, tolerance, rounds)
    if not refused:
        return found
    name, error = max(refused.items(), key=lambda each: each[1].best)
    lines = [
        f"--tolerance {share(tolerance, 3)} of {of.format(name)} cannot be reached: {error.why}",
        f"best now  --tolerance '{reachable(error.best)}'",
        *remedies.get(error.binds, ()),
    ]
    raise RangeError("\n  ".join(lines))


def wanted_of(of: str, tolerance: str, time: float | None = None) -> str:
    """The line of a plan with what is wanted: a tolerance, which is empty if there is none, or a bench time [s]."""
    time_text = "" if time is None else show(time, "s")
    within = time_text and f", within {time_text}"
    return f"wanted         {f'{tolerance} of {of}{within}' if tolerance else f'{of} as good as {time_text} allow'}"


def ended_by(each: str, tolerance: str, time: float | None, missed: str, where: str = "") -> str:
    """Why a run ended, for people.

    Args:
        each: what it repeats.
        tolerance: the tolerance; empty: as good as the time allows.
        time: its bench time [s]; None: as long as the tolerance takes.
        missed: where the tolerance is not reached; empty: it is.
        where: where it is reached, in that case.
    """
    if not tolerance:
        return f"another {each} would not have ended within {show(time or 0.0, 's')}"
    within = "" if time is None else f" within {show(time, 's')}"
    return f"{tolerance} NOT REACHED{within}{missed}" if missed else f"{tolerance} reached{where}{within}"


def too_long(time: float, where: str) -> RangeError:
    """The refusal of a time [s] that the most load sets of a run do not fill."""
    return RangeError(
        f"--time {as_typed(time, 's')} holds more than {MOST_SETS} load sets {where}, the most of a run; give less time"
    )


def binding(plan: Allocation) -> str:
    """The line of a plan for people with what binds."""
    return f"binds          {plan.binds}, {plan.shares[plan.binds]:.0%} of the variance"


def share(u: float, digits: int = 2) -> str:
    """A share in percent, with so many digits."""
    percent = 100 * u
    return f"{percent:.{digits}g} %" if percent < 10**digits - 0.5 else f"{percent:.0f} %"


def reachable(least: float) -> str:
    """A share in percent that may be asked for where `least` is the least."""
    return share(rounded_up(least))
