"""What scenes cost: lines `a + b t` of processor time for t seconds of bench, measured so that they can be repeated.

    taken = timed([scene, leaving_out(scene, ["hysteresis"])], Question())
    taken.more(0, 1).told()  # what hysteresis costs

The time of one dwell divided by it is no price: what is spent once makes it the larger, the shorter the dwell. Every
scene is timed at several dwells, in rounds of random order, with one seed a round. What was computed of a system is
forgotten before each call, so that no scene pays for another. The garbage collector is off, and palpate computes in one
thread. Each point of a line is a median over the rounds, weighted by its own spread.
"""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from palpate.instrument import notice
from palpate.instrument.arrays import Floats
from palpate.simulators.linear.path import forget
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.waveforms import films_sampled
from palpate.simulators.scenes.scene import LARGEST_SEED, Scene

CYCLES = (10, 100, 400, 1000)  # of the drive in each dwell: 1, 10, 40 and 100 s at 10 Hz
FEWEST = 15  # rounds, which double until every u(a) is small
SMALL = 0.1  # of the first scene's a
LONGEST, LEAST = 60.0, 5  # s of wall time after which no round begins, if there are so many
BOOTSTRAPS = 200
PRICE = ("ms", "µs/s")  # titles of the columns of `PriceLine.told`
PRICE_OF = "ms once, and µs for each second of bench; no digit is below its standard uncertainty u, and < is 2 u"
CLOCK = 1e-9  # s, a step of the clock of processor time
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, slots=True)
class PriceLine:
    """Processor time a + b t for t seconds of bench.

    Attributes:
        a_s, u_a_s: what is spent once, and its standard uncertainty [s].
        b_s_per_s, u_b_s_per_s: what each second of bench takes, and its standard uncertainty [s/s].
    """

    a_s: float
    u_a_s: float
    b_s_per_s: float
    u_b_s_per_s: float

    def seconds(self, dwell: float) -> float:
        """Processor time for so many seconds of bench [s]."""
        return self.a_s + self.b_s_per_s * dwell

    def told(self) -> tuple[str, str]:
        """Texts of a in ms and of b in µs a second, for people."""
        return digits(1e3 * self.a_s, 1e3 * self.u_a_s), digits(1e6 * self.b_s_per_s, 1e6 * self.u_b_s_per_s)


def digits(value: float, u: float) -> str:
    """A number without a digit below its standard uncertainty, or "< 2u" where it is less: 12.63, u 0.21: "12.6"."""
    limit = 2 * u
    small = abs(value) < limit
    shown = limit if small else value
    if u > 0:
        place = math.floor(math.log10(limit if small else u))
        steps = shown / 10.0**place
        shown = (math.ceil(steps) if small else round(steps)) * 10.0**place
        text = f"{shown:.{max(-place, 0)}f}"
    else:
        text = f"{shown:.3g}"
    return f"< {text}" if small else text


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """Processor times of scenes.

    Attributes:
        dwells: (d,) s of bench.
        seconds: (rounds, d, scenes) s.
    """

    dwells: Floats
    seconds: Floats

    def of(self, number: int) -> PriceLine:
        """The price of a scene by its number."""
        return line(self.dwells, self.seconds[:, :, number])

    def more(self, number: int, than: int) -> PriceLine:
        """What a scene costs more than another, by differences within a round."""
        return line(self.dwells, self.seconds[:, :, number] - self.seconds[:, :, than])


def line(dwells: Floats, seconds: Floats) -> PriceLine:
    """The line through the medians of rounds (rounds, d) of times; its uncertainties by drawing rounds anew."""
    picks = np.random.default_rng(len(seconds)).integers(len(seconds), size=(BOOTSTRAPS, len(seconds)))
    again = np.median(seconds[picks], axis=1)
    weights = 1 / np.maximum(again.std(axis=0, ddof=1), CLOCK)
    columns = np.stack([np.ones_like(dwells), dwells], axis=1)
    solved = np.linalg.pinv(columns * weights[:, np.newaxis]) * weights
    a, b = solved @ np.median(seconds, axis=0)
    u_a, u_b = (again @ solved.T).std(axis=0, ddof=1)
    return PriceLine(float(a), float(u_a), float(b), float(u_b))


def timed(scenes: Sequence[Scene], question: Question, progress: Progress | None = None) -> Taken:
    """Time scenes at several dwells, until every difference from the first one is known well enough.

    Args:
        scenes: the whole scene first, then others.
        question: sample, load and frequency.
        progress: called with the number of rounds that are done, of all that are planned, and what is done.

    Raises:
        RangeError: the model of a scene does not answer for the sample.
    """
    dwells = np.array(CYCLES) / question.frequency
    order = np.random.default_rng(scenes[0].seed)
    rounds: list[Floats] = []
    begun, planned = time.monotonic(), FEWEST
    with _without_collector():
        once = _seconds(scenes[0], question, dwells[-1])
        notice.price(f"timing {len(scenes)} scenes", min(FEWEST * len(dwells) * (len(scenes) + 1) * once, LONGEST))
        while len(rounds) < planned and (len(rounds) < LEAST or time.monotonic() - begun < LONGEST):
            if progress is not None:
                progress(len(rounds), planned, "timing")
            rounds.append(_round(scenes, question, dwells, len(rounds), order))
            taken = Taken(dwells, np.array(rounds))
            if len(rounds) == planned:
                least = SMALL * taken.of(0).a_s
                if any(taken.more(0, number).u_a_s > least for number in range(1, len(scenes))):
                    planned *= 2
    return taken


def _round(
    scenes: Sequence[Scene], question: Question, dwells: Floats, number: int, order: np.random.Generator
) -> Floats:
    """Times (d, scenes) of each scene at each dwell, in random order; the first call at each dwell does not count."""
    seeded = [each.with_seed((each.seed + number) % (LARGEST_SEED + 1)) for each in scenes]
    found = np.empty((len(dwells), len(scenes)))
    for place in order.permutation(len(dwells)):
        _seconds(seeded[0], question, dwells[place])
        for which in order.permutation(len(scenes)):
            found[place, which] = _seconds(seeded[which], question, dwells[place])
    return found


def _seconds(scene: Scene, question: Question, dwell: float) -> float:
    forget()
    begun = time.process_time()
    films_sampled(scene, question, dwell)
    return time.process_time() - begun


@contextmanager
def _without_collector() -> Iterator[None]:
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
