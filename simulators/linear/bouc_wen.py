"""The Bouc-Wen operator: hysteresis of rounded corners, without a rate of its own.

    z' = k (x' - b |x'| z - (1 - b) x' |z|),   -1 <= z <= 1

Along a stretch in which x moves in one direction and z keeps its sign, this is linear in |dx|. So each step is an
exponential that is cut where z passes zero. This is exact where x does not turn between its samples, and stable for
steps of any size. It is no linear system in time; therefore a scene's hysteresis is made of play operators, which are
linear between their transitions. Ismail, Ikhouane and Rodellar, "The hysteresis Bouc-Wen model, a survey", Arch.
Comput. Methods Eng. 16 (2009), with n = 1.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.simulators.linear.integrators import LOST, IntegratorError

PERIOD, CYCLES, FINEST = 0.1, 3, 10_000  # s; cycles; steps in a cycle of the reference
STEPS = (100, 1000)  # numbers of steps in a cycle
STIFFNESS, SHARE = 60.0, 0.9  # k in units of 1 over the amplitude of x; b


def compare() -> Iterator[IntegratorError]:
    """Compare both methods under a sine with the exact one in finer steps."""
    truth = exact(_sine(FINEST), STIFFNESS, SHARE)
    for method, solve in (("Bouc-Wen, exact", exact), ("Bouc-Wen, explicit Euler", explicit_euler)):
        for steps in STEPS:
            x, start = _sine(steps), time.process_time()
            found = solve(x, STIFFNESS, SHARE)
            seconds = time.process_time() - start
            error = float(np.abs(found - truth[:: FINEST // steps]).max())
            lost = not error < LOST
            yield IntegratorError(method, PERIOD / steps, None if lost else error, seconds, "runs away" if lost else "")


def _sine(steps: int) -> Floats:
    return np.asarray(np.sin(2 * np.pi * np.arange(CYCLES * steps + 1) / steps))


def exact(x: Floats, stiffness: float, share: float = 0.5, start: float = 0.0) -> Floats:
    """z at samples (n,) of x, by exponentials.

    Args:
        x: (n,), samples.
        stiffness: k, in 1 over the unit of x.
        share: b, 0.5 to 1; for less z would pass 1.
        start: z at the first sample.
    """
    z, found = start, np.empty(len(x))
    for number, step in enumerate(np.diff(x, prepend=x[:1])):
        z = found[number] = _after(z, float(step), stiffness, share)
    return found


def explicit_euler(x: Floats, stiffness: float, share: float = 0.5, start: float = 0.0) -> Floats:
    """z at samples (n,) of x by Euler's method, which runs away where stiffness times step is above 2."""
    z, found = start, np.empty(len(x))
    with np.errstate(all="ignore"):
        for number, step in enumerate(np.diff(x, prepend=x[:1])):
            z += stiffness * (step - share * abs(step) * z - (1 - share) * step * abs(z))
            found[number] = z
    return found


def _after(z: float, step: float, stiffness: float, share: float) -> float:
    """z after a step of x in one direction."""
    if step == 0:
        return z
    side, left = math.copysign(1.0, step), stiffness * abs(step)
    z *= side  # the signs are chosen so that x rises
    if z < 0:
        rate = 2 * share - 1  # while z moves towards zero, z' = 1 - rate z
        to_zero = math.log1p(-rate * z) / rate if rate else -z
        if left <= to_zero:
            return side * (z * math.exp(-rate * left) + (-math.expm1(-rate * left) / rate if rate else left))
        z, left = 0.0, left - to_zero
    return side * (z * math.exp(-left) - math.expm1(-left))
