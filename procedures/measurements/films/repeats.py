"""A tolerance of each film's sensitivity: how often the loads are repeated on each tooth.

The load sets on a tooth take the loads in turn, in whole rounds at each frequency. The first ones tell how much the
films' gains scatter, and that tells how many there are in all, as `instrument.allocation.stopping` has it. The error of
the load cell's curve is common to all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np

from palpate.instrument.allocation.allocate import Allocation, BelowFloor, allocate
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.allocation.stopping import FIRST, enough
from palpate.instrument.calibration.films import LOAD_CELL, REPEATS
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.mean_ratio import NOISE, PRIOR_FREEDOM
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.procedures.engine.plan import Predicted, noise_of, point_seconds
from palpate.procedures.engine.promise import RESULTS
from palpate.procedures.lab.mounts import MOUNTING
from palpate.procedures.measurements.films.expected import expected_sensitivities
from palpate.procedures.measurements.films.result import PressedPoint
from palpate.procedures.measurements.repeated_sets import MOST_SETS, in_rounds, most_sets, reachable, share
from palpate.procedures.showing.plan import duration


@dataclass(frozen=True)
class FilmRepeats:
    """The load sets on each tooth that give the sensitivity of its films a tolerance.

    Attributes:
        design: the sensor.
        cell: calibration of the load cell.
        loads: loads of one round, peak to peak [N].
        frequencies: frequencies of the load [Hz], each of which has as many rounds.
        dwell: dwell of a set [s].
        tolerance: relative standard uncertainty of each film's sensitivity.
    """

    design: Design
    cell: LoadCellCalibration
    loads: tuple[float, ...]
    frequencies: tuple[float, ...]
    dwell: float
    tolerance: float

    @cached_property
    def allocation(self) -> Allocation:
        """The plan for a tooth at one frequency, in whole rounds.

        Raises:
            RangeError: the load cell's calibration alone is not below the tolerance, or it takes too many sets.
        """
        return _allocation(self)

    def lines(self) -> list[BudgetLine]:
        """Lines of the sensitivity of a film by the sets of one frequency; each frequency tells as much of it."""
        worst = max(film.scatter for film in self.design.films)
        weakest = min(film.sensitivity for film in self.design.films) * min(self.loads)
        share = 1 / math.sqrt(len(self.frequencies))
        return [
            BudgetLine(REPEATS, share * worst, RepeatUnit.SET, PRIOR_FREEDOM),
            BudgetLine(NOISE, share * 2 * noise_of(self.design) / weakest, RepeatUnit.SECOND),
            BudgetLine(LOAD_CELL, self.cell_u, RepeatUnit.NOTHING, self.cell.degrees_of_freedom or math.inf),
        ]

    @property
    def cell_u(self) -> float:
        """Relative standard uncertainty of a sensitivity by the load cell's curve."""
        return self.cell.mean_curve_u(np.asarray(self.loads, dtype=np.float64))

    @property
    def costs(self) -> Costs:
        """Bench times of a tooth at one frequency, on average; it is pressed once, at the first frequency."""
        first = point_seconds(self.frequencies[0], self.dwell, first=True)
        later = [point_seconds(frequency, self.dwell, first=False) for frequency in self.frequencies]
        return Costs((first - later[0]) / len(later), 0.0, math.fsum(later) / len(later) - self.dwell)

    def most(self) -> int:
        """The most load sets on a tooth at one frequency, in whole rounds."""
        return most_sets(self.allocation, len(self.loads))

    def has_enough(self, points: Sequence[PressedPoint]) -> bool:
        """Whether the points of a tooth at one frequency are enough for each of its films."""
        if not points or len(points) % len(self.loads):
            return False
        own = [number for number, film in enumerate(self.design.films) if points[0].tooth - 1 in film.teeth]
        try:
            return all(self._enough([p.voltages_V[number] / p.load_measured_N for p in points]) for number in own)
        except RangeError:  # by the scatter that was found no time is enough
            return True

    def _enough(self, gains: Sequence[float]) -> bool:
        sensitivity = 1 / math.sqrt(len(self.frequencies))
        return bool(enough(self.lines(), self.costs, self.tolerance, self.allocation, sensitivity, [gains]).why)

    def predicted(self) -> Predicted:
        """What the run is predicted to take and to give; a plan for people."""
        plan, teeth = self.allocation, len(self.design.teeth)
        sets, seconds = plan.sets * len(self.frequencies), plan.seconds * teeth * len(self.frequencies)
        lines = [
            f"wanted         {share(self.tolerance, 3)} of the sensitivity of each film",
            f"plan           {sets} load sets on each tooth, of {show(self.dwell, 's')}: {duration(seconds)} "
            f"(person {MOUNTING * teeth:g} s)",
            f"expected       {share(plan.u, 3)}, of which the load cell's calibration has {share(self.cell_u, 3)}",
            f"binds          {plan.binds}, {plan.shares[plan.binds]:.0%} of the variance",
        ]
        loads = self.loads * (plan.sets // len(self.loads))
        results = expected_sensitivities(self.design, loads, len(self.frequencies), self.dwell, self.cell)
        told = {
            RESULTS: [asdict(each) for each in results],
            "planned": {"sets": sets, "seconds": seconds, "u": plan.u, "binds": plan.binds, "shares": plan.shares},
        }
        return Predicted(seconds, plan.u, told, lines)


def _allocation(asked: FilmRepeats) -> Allocation:
    lines = asked.lines()
    try:
        found = allocate(lines, asked.costs, asked.tolerance, asked.dwell, FIRST)
    except BelowFloor as error:
        told = [
            f"--tolerance {share(asked.tolerance, 3)} cannot be reached: the calibration of the {error.line} leaves "
            f"{share(error.floor, 3)} of each sensitivity, which no load set lowers",
            f"best now  {share(error.floor, 3)}",
            "or        calibrate the load cell with more weights and runs: palpate calibrate load-cell --runs 3",
            "or        greater --loads, at which its zero counts for less",
            "note      a force ratio does not feel the load cell: it cancels in tooth and base",
        ]
        raise RangeError("\n  ".join(told)) from None
    if found.sets > MOST_SETS:
        best = reachable(budget(lines, 1, MOST_SETS, asked.dwell).u)
        raise RangeError(
            f"--tolerance {share(asked.tolerance, 3)} takes {found.sets} load sets on each tooth, above the limit of "
            f"{MOST_SETS}; give --tolerance '{best}' or more"
        )
    return in_rounds(lines, asked.costs, found.sets, asked.dwell, len(asked.loads))
