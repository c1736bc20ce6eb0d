"""A tolerance of the mean ratio of each sample, below what one load set can have: how often the loads are repeated.

The sets of a sample take the loads in turn, in whole rounds. Its first sets tell how much sets scatter, and that tells
how many there are in all, as `instrument.allocation.stopping` has it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property

from palpate.instrument.allocation.allocate import Allocation, BelowFloor, allocate
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.allocation.stopping import FIRST, RunRatio, answer, enough
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import calibration_u, pickup_u
from palpate.instrument.findings.mean_ratio import CALIBRATION, NOISE, PICKUP, PRIOR_FREEDOM, SCATTER
from palpate.instrument.quantity import counted, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.dwell import STEP, Floor, floor_u, whole_steps
from palpate.procedures.engine.plan import Predicted, expected_noise, point_seconds
from palpate.procedures.engine.promise import RESULTS, Expected
from palpate.procedures.lab.mounts import BY_HAND, Mounts
from palpate.procedures.measurements.loads.result import ratio_of
from palpate.procedures.measurements.prospects import expected_ratio
from palpate.procedures.measurements.repeated_sets import MOST_SETS, in_rounds, most_sets, reachable, share
from palpate.procedures.showing.plan import duration

REMEDIES = {
    CALIBRATION: "calibrate the films with more load sets: palpate calibrate films",
    PICKUP: "tie the films' cables down, and give the smaller pick-up in the bench file",
}


@dataclass(frozen=True)
class Repeats:
    """The load sets of samples whose mean ratios shall have a tolerance.

    Attributes:
        design: the sensor.
        samples: names of the samples.
        loads: loads of one round, peak to peak [N].
        frequency: frequency of the load [Hz].
        tolerance: relative standard uncertainty of the mean ratio of each sample.
        mounts: who mounts the samples, and how long that takes.
    """

    design: Design
    samples: tuple[str, ...]
    loads: tuple[float, ...]
    frequency: float
    tolerance: float
    mounts: Mounts = BY_HAND

    @cached_property
    def allocations(self) -> dict[str, Allocation]:
        """The plan for each sample, in whole rounds and whole steps of dwell.

        Raises:
            RangeError: what no set lowers is not below the tolerance; the message says what would.
        """
        return {sample: _allocation(self, sample) for sample in self.samples}

    def lines(self, sample: str) -> list[BudgetLine]:
        """Lines of the mean ratio of a sample."""
        ratio = expected_ratio(self.design, sample)
        noise = math.sqrt(
            math.fsum(expected_noise(self.design, load, ratio) ** 2 for load in self.loads) / len(self.loads)
        )
        lines = [
            BudgetLine(SCATTER, self.design.ratio_scatter, RepeatUnit.SET, PRIOR_FREEDOM),
            BudgetLine(NOISE, noise, RepeatUnit.SECOND),
        ]
        if films := calibration_u(self.design):
            lines.append(BudgetLine(CALIBRATION, films, RepeatUnit.NOTHING, self.design.film_freedom or math.inf))
        lines += [
            BudgetLine(PICKUP, part.u, RepeatUnit.NOTHING)
            for part in floor_of(self.design, ratio)
            if part.name == PICKUP
        ]
        return lines

    @property
    def costs(self) -> Costs:
        """Bench times of a sample, which is mounted once."""
        first, later = (point_seconds(self.frequency, STEP, first=first, mounts=self.mounts) for first in (True, False))
        return Costs(first - later, 0.0, later - STEP)

    def most(self, sample: str) -> int:
        """The most load sets of a sample, in whole rounds."""
        return most_sets(self.allocations[sample], len(self.loads))

    def has_enough(self, sample: str, taken: int, ratios: Sequence[float]) -> bool:
        """Whether the valid `ratios` of a sample are enough; `taken` counts all its sets."""
        if not taken or taken % len(self.loads):
            return False
        plan = self.allocations[sample]
        try:
            return bool(enough(self.lines(sample), self.costs, self.tolerance, plan, 1.0, [ratios]).why)
        except RangeError:  # by the scatter that was found no time is enough
            return True

    def answer(self, sample: str, ratios: Sequence[float]) -> RunRatio:
        """Mean ratio of a sample, and its relative uncertainty by what its sets scatter."""
        return answer(self.lines(sample), self.allocations[sample], 1.0, [ratios])

    def predicted(self) -> Predicted:
        """What the run is predicted to take and to give; a plan for people."""
        plans = self.allocations
        seconds = math.fsum(plan.seconds for plan in plans.values())
        worst = max(plans.values(), key=lambda plan: plan.u)
        sets = ", ".join(f"{sample}: {plan.sets}" for sample, plan in plans.items())
        dwell = max(plan.dwell for plan in plans.values())
        lines = [
            f"wanted         {share(self.tolerance, 3)} of the mean ratio of each sample, below the "
            f"{share(self.design.ratio_scatter, 3)} that one load set scatters",
            f"plan           load sets of each sample: {sets}, of {show(dwell, 's')} at most: {duration(seconds)} "
            f"({self.mounts.described(len(plans))})",
            f"expected       {share(worst.u, 3)} at most",
            f"binds          {worst.binds}, {worst.shares[worst.binds]:.0%} of the variance",
        ]
        results = [Expected(ratio_of(sample), plan.u) for sample, plan in plans.items()]
        told = {
            RESULTS: [asdict(each) for each in results],
            "tolerance_of": "mean",
            "planned": {
                sample: {"sets": p.sets, "dwell_s": p.dwell, "seconds": p.seconds, "u": p.u, "binds": p.binds,
                         "shares": p.shares}
                for sample, p in plans.items()
            },
        }  # fmt: skip
        return Predicted(seconds, worst.u, told, lines)


def _allocation(asked: Repeats, sample: str) -> Allocation:
    lines = asked.lines(sample)
    shortest = whole_steps(max(STEP, 1 / asked.frequency))
    try:
        found = allocate(lines, asked.costs, asked.tolerance, shortest, FIRST)
    except BelowFloor as error:
        told = [
            f"--tolerance {share(asked.tolerance, 3)} cannot be reached for sample {sample}: {error.line} leaves "
            f"{share(error.floor, 3)} of its mean ratio, which no load set lowers",
            f"best now  {share(error.floor, 3)}",
            f"or        {REMEDIES[error.line]}",
        ]
        raise RangeError("\n  ".join(told)) from None
    if found.sets > MOST_SETS:
        best = reachable(budget(lines, 1, MOST_SETS, found.dwell).u)
        raise RangeError(
            f"--tolerance {share(asked.tolerance, 3)} takes {counted(found.sets, 'load set')} of sample {sample}, "
            f"{duration(found.seconds)}, above the limit of {MOST_SETS} sets; give --tolerance '{best}' or more"
        )
    dwell = whole_steps(max(found.dwell, shortest))
    return in_rounds(lines, asked.costs, found.sets, dwell, len(asked.loads))


def floor_of(design: Design, ratio: float) -> tuple[Floor, ...]:
    """Relative uncertainties of a force ratio that no dwell lowers, for one tooth and its base."""
    scatter = Floor(SCATTER, design.ratio_scatter)
    pickup = pickup_u(design) * math.hypot(1.0, 1 / ratio)
    return (scatter, Floor(PICKUP, pickup)) if pickup else (scatter,)


def one_set_suffices(design: Design, samples: Sequence[str], tolerance: float) -> bool:
    """Whether one load set of each sample can have a tolerance; if not, it is one of the mean."""
    return all(tolerance > floor_u(floor_of(design, expected_ratio(design, sample))) for sample in samples)
