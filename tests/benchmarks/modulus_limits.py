"""What no prediction of a modulus' bench time can keep: `python -m tests.benchmarks modulus_limits`.

A run that knew how much its sets scatter would take the least time that reaches the tolerance. A run's mean time is not
below it. One prediction holds two truths to a tenth only if the quotient of their least times is at most 1.1 / 0.9.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from scipy.special import ndtr

from palpate.instrument.allocation.allocate import cheapest
from palpate.instrument.allocation.lines import RepeatUnit, merged
from palpate.instrument.allocation.stopping import FIRST, first_sets
from palpate.instrument.allocation.times import times
from palpate.instrument.uncertainty.budget import coverage_factor
from palpate.procedures.measurements.object_modulus.prospect import costs_of, lines_of, most_sets
from tests.benchmarks.modulus_budget import FREEDOM, KINDS, asked
from tests.benchmarks.modulus_figures import BENCH_TIME
from tests.benchmarks.row import Row

TOLERANCE, FACTOR = 0.02, 1.5
CASES = (("scatter learned", (120e3, 250e3, 500e3)), ("moving cables", (500e3,)))
BETTER = (9.0, 12.0)  # degrees of freedom of the scatter that is known
REFERENCES = 8.0  # those of the spread about three references


def measure() -> Iterator[Row]:
    for name, moduli in CASES:
        for modulus in moduli:
            yield from limits(name, modulus)
    factor = coverage_factor(REFERENCES)
    yield Row(
        f"spread as {REFERENCES:g} degrees of freedom estimate it: share that Student's factor {factor:.2f} holds",
        f"{2 * float(ndtr(factor)) - 1:.1%}",
    )


def limits(name: str, modulus: float) -> Iterator[Row]:
    """Least times where scatter is as stated and `FACTOR` times that, and the mean that is predicted [s]."""
    kind = KINDS[name]
    truth = kind.truth(modulus, 1)
    asking = asked(kind, TOLERANCE, truth)
    course = asking.course_on(truth.target)
    wanted, prospect = course.wanted, course.prospect
    plan, costs = prospect.allocation, costs_of(prospect.load, wanted.frequency, wanted.mounts)
    cycles = round(plan.dwell * wanted.frequency)
    lines = lines_of(truth.design, prospect.found, prospect.load, wanted, absolute=False, cycles=cycles)

    def least(scatter: float) -> float:
        true = [replace(line, u=scatter * line.u) if line.per is RepeatUnit.SET else line for line in lines]
        mountings, sets, _ = cheapest(merged(true, plan.dwell), costs, TOLERANCE, plan.dwell, FIRST)
        return costs.seconds(mountings, sets, plan.dwell)

    def predicted(freedom: float) -> float:
        known = [replace(line, degrees_of_freedom=freedom) if line.per is RepeatUnit.SET else line for line in lines]
        return times(known, costs, TOLERANCE, plan, (first_sets(plan), most_sets(plan, wanted))).mean

    what = f"{name}, {modulus / 1e3:g} kPa, {TOLERANCE:.0%}"
    stated, more, mean = least(1.0), least(FACTOR), predicted(FREEDOM)
    yield Row(
        f"{what}: least time, scatter as stated; x {FACTOR:g}", f"{stated:.1f}; {more:.1f} s = {more / stated:.2f}"
    )
    yield Row("  quotient that one prediction holds to a tenth", f"{(1 + BENCH_TIME) / (1 - BENCH_TIME):.2f}")
    yield Row("  mean that is predicted; scatter as stated over it", f"{mean:.1f} s; {stated / mean:.2f}")
    better = ", ".join(f"{stated / predicted(freedom):.2f}" for freedom in BETTER)
    told = " and ".join(f"{freedom:g}" for freedom in BETTER)
    yield Row(f"  the same with {told} degrees of freedom of the scatter, not {FREEDOM:g}", better)
