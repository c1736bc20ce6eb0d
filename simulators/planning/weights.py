"""What the effects of a scene change and what they cost, measured: its films with an effect and without it."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from palpate.instrument import notice
from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError
from palpate.instrument.notice import price
from palpate.instrument.sensor.design import FILM_KINDS
from palpate.instrument.signals.estimate import amplitudes
from palpate.simulators.bounds import pairs_of
from palpate.simulators.effects import effect_class
from palpate.simulators.linear.path import forget
from palpate.simulators.physics.effect import CanEffect, CellEffect, LineEffect, rival
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.waveforms import SAMPLES_PER_CYCLE, films_sampled
from palpate.simulators.scenes.scene import LARGEST_SEED, Scene

# --- what scenes cost ----------------------------------------------------------------------------------

#     taken = timed([scene, leaving_out(scene, ["hysteresis"])], Question())
#     taken.more(0, 1).texts()  # what hysteresis costs
#
# The time of one dwell divided by it is no price: what is spent once makes it the larger, the shorter the dwell. Every
# scene is timed at several dwells, in rounds of random order, with one seed a round. What was computed of a system is
# forgotten before each call, so that no scene pays for another. The garbage collector is off, and palpate computes in
# one thread. Each point of a line is a median over the rounds, weighted by its own spread.


CYCLES = (10, 100, 400, 1000)  # of the drive in each dwell: 1, 10, 40 and 100 s at 10 Hz
FEWEST = 15  # rounds, which double until every u(a) is small
SMALL = 0.1  # of the first scene's a
LONGEST, LEAST = 60.0, 5  # s of wall time after which no round begins, if there are so many
BOOTSTRAPS = 200
PRICE = ("ms", "µs/s")  # titles of the columns of `PriceLine.texts`
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

    def texts(self) -> tuple[str, str]:
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


# --- what effects change and cost ----------------------------------------------------------------------


DRAWS = 4  # seeds, from the scene's own on
MOST = 20_000_000  # samples of all films together in a draw, which take some hundred megabytes
UNFELT = (CanEffect, LineEffect, CellEffect)  # the films do not show what these change: times, and the indicator


@dataclass(frozen=True, slots=True)
class Weight:
    """What an effect changes and costs.

    Attributes:
        name: its name.
        force, ratio: root mean square, over the draws, of the relative change of force and force ratio by leaving the
            effect out of the scene, or by putting it in with its default parameters; of several films, the greatest.
            None: the films do not show what it changes (times on a bus, the indicator), it cannot stand beside the
            scene's effects, or the films give no ratio with the change.
    """

    name: str
    force: float | None
    ratio: float | None

    @property
    def change(self) -> float | None:
        """The greater of both changes."""
        return None if self.force is None or self.ratio is None else max(self.force, self.ratio)


@dataclass(frozen=True, slots=True)
class Subset:
    """A scene with a part of its effects.

    Attributes:
        without: names of the effects that are left out.
        force, ratio: change of the whole scene's force and force ratio by leaving them out together, as in `Weight`.
        price: processor time of what is left.
    """

    without: tuple[str, ...]
    force: float
    ratio: float
    price: PriceLine

    @property
    def change(self) -> float:
        """The greater of both changes."""
        return max(self.force, self.ratio)


def weigh(scene: Scene, question: Question, more: Sequence[str] = (), progress: Progress | None = None) -> list[Weight]:
    """Weights of the scene's effects, and of others that it leaves out.

    Args:
        scene: the scene.
        question: sample, load, frequency and dwell.
        more: names of other effects.
        progress: called with the number of effects that are done, of all, and the name of the next.

    Raises:
        RangeError: the scene's model does not answer for the sample.
        EstimateError: the films of the scene give no force ratio.
    """
    whole = see(scene, question)
    names = [*scene.effects, *more]
    notice.price(f"measuring {len(names)} effects", len(names) * DRAWS * whole.seconds)
    found = []
    for done, name in enumerate(names):
        if progress is not None:
            progress(done, len(names), name)
        found.append(_weighed(scene, question, whole, name))
    return found


def priced(scene: Scene, question: Question, progress: Progress | None = None) -> dict[str, PriceLine]:
    """The scene's price under "", and what each of its effects that the films feel adds to it.

    Raises RangeError: the scene's model does not answer for the sample.
    """
    felt = [name for name, effect in scene.effects.items() if not isinstance(effect, UNFELT)]
    taken = timed([scene, *(leaving_out(scene, [name]) for name in felt)], question, progress)
    return {"": taken.of(0), **{name: taken.more(0, number) for number, name in enumerate(felt, 1)}}


def nested(
    scene: Scene, question: Question, weights: Iterable[Weight], progress: Progress | None = None
) -> list[Subset]:
    """The whole scene, and the scene with ever fewer effects: the one that changes least is left out first.

    Effects that the films do not feel stay. Arguments and errors as those of `weigh`.
    """
    whole = see(scene, question)
    weighted = [(each.change, each.name) for each in weights if each.change is not None and each.name in scene.effects]
    order = [name for _, name in sorted(weighted)]
    notice.price(f"measuring {len(order)} subsets", len(order) * DRAWS * whole.seconds)
    left, found = [scene], [(0.0, 0.0)]
    for count in range(1, len(order) + 1):
        if progress is not None:
            progress(count - 1, len(order), f"without {order[count - 1]}")
        left.append(leaving_out(scene, order[:count]))
        found.append(_rms(changes(whole, see(left[-1], question))))
    taken = timed(left, question, progress)
    return [Subset(tuple(order[:count]), *each, taken.of(count)) for count, each in enumerate(found)]


def front(subsets: Iterable[Subset], dwell: float) -> list[Subset]:
    """The subsets than which no other is both nearer to the whole scene and quicker, from the nearest on.

    dwell: seconds of bench for which they are compared.
    """
    best: list[Subset] = []
    for each in sorted(subsets, key=lambda subset: (subset.change, subset.price.seconds(dwell))):
        if not best or each.price.seconds(dwell) < best[-1].price.seconds(dwell):
            best.append(each)
    return best


def leaving_out(scene: Scene, without: Iterable[str]) -> Scene:
    """The scene without some effects, by their names."""
    out = set(without)
    return replace(scene, effects={name: effect for name, effect in scene.effects.items() if name not in out})


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Draws of what a scene's films show.

    Attributes:
        forces: amplitudes of the films under bases (draws, bases) [V].
        ratios: amplitudes of films under teeth over those under their bases (draws, pairs).
        seconds: least processor time of a draw [s].
    """

    forces: Floats
    ratios: Floats
    seconds: float


def see(scene: Scene, question: Question, start: float = 0.0, draws: int = DRAWS) -> Seen:
    """What the films of a scene show in each draw.

    Args:
        scene: the scene.
        question: sample, load, frequency and dwell.
        start: time of the bench at which the drive is set [s].
        draws: number of seeds, from the scene's own on.

    Raises:
        RangeError: the scene's model does not answer for the sample.
        EstimateError: the films give no force ratio, or the dwell has too many samples to be held.
    """
    films = scene.design.films
    samples = len(films) * SAMPLES_PER_CYCLE * question.frequency * question.dwell
    if samples > MOST:
        raise EstimateError(
            f"scene {scene.name}: {samples:.2g} samples of {len(films)} films in a dwell of {question.dwell:g} s are "
            f"more than {MOST:.2g}, which are held at once; give a shorter --dwell"
        )
    pairs, bases = pairs_of(scene.design), [i for i, film in enumerate(films) if film.kind == FILM_KINDS[1]]
    found, seconds = [], []
    for draw in range(draws):
        begun = time.process_time()
        seeded = scene.with_seed((scene.seed + draw) % (LARGEST_SEED + 1))
        times, volts = films_sampled(seeded, question, question.dwell, start)
        seconds.append(time.process_time() - begun)
        found.append(amplitudes(times, volts, question.frequency))
    seen = np.array(found)
    if not (seen[:, bases] > 0).all():
        raise EstimateError(f"scene {scene.name}: a film under a base shows no amplitude; give a larger --load")
    ratios = np.stack([seen[:, tooth] / seen[:, base] for tooth, base in pairs], axis=1)
    return Seen(seen[:, bases], ratios, min(seconds))


def _weighed(scene: Scene, question: Question, whole: Seen, name: str) -> Weight:
    simulated = name in scene.effects
    effect = scene.effects[name] if simulated else effect_class(name)()
    if isinstance(effect, UNFELT) or (not simulated and rival(effect, scene.effects)):
        return Weight(name, None, None)
    other = leaving_out(scene, [name]) if simulated else replace(scene, effects={**scene.effects, name: effect})
    try:
        return Weight(name, *_rms(changes(whole, see(other, question))))
    except EstimateError:
        return Weight(name, None, None)


def changes(whole: Seen, other: Seen) -> tuple[Floats, Floats]:
    """Relative changes of forces and ratios in each draw (draws,), each the greatest of all films."""
    with np.errstate(divide="ignore", invalid="ignore"):
        force, ratio = (
            np.abs(after / before - 1).max(axis=1)
            for before, after in ((whole.forces, other.forces), (whole.ratios, other.ratios))
        )
    return force, ratio


def _rms(changes: tuple[Floats, Floats]) -> tuple[float, float]:
    force, ratio = (float(np.sqrt(np.mean(each**2))) for each in changes)
    return force, ratio


# --- what an answer does not feel ----------------------------------------------------------------------

#     reduced(read_scene("everything"), 1e-3, [(Question("2", 4.0), 0.0), (Question("6", 1.5), 600.0)])
#
# Force and force ratio are computed with all effects and with some, with the same noise and scatter, for each question
# and at several times of the bench. What is left out together changes none of them by more than the fidelity. It is
# measured in a few draws and not proven, unlike the bounds by which effects `when = "auto"` are chosen. A bench without
# these effects comes to its load sets at other times, so scatter and noise of a run may be drawn anew.


FEW = 2  # seeds; every draw of every question counts


def reduced(scene: Scene, fidelity: float, asked: Sequence[tuple[Question, float]]) -> Scene:
    """The scene without the effects that change no answer by more than the fidelity.

    The effect that changes the first question's answer least is left out first, then others as long as all answers
    allow it. Effects that the films do not show stay: the times of both buses, and the load cell.

    Args:
        scene: the scene.
        fidelity: greatest relative change of force and force ratio.
        asked: the measurements, each with the time of the bench at which its load is set [s].

    Raises:
        RangeError: the scene's model does not answer for a sample.
        EstimateError: the films of the whole scene give no force ratio.
    """
    whole = [see(scene, *each, FEW) for each in asked]

    def change(without: Iterable[str], count: int) -> float:
        less = leaving_out(scene, without)
        try:
            return max(
                _greatest(before, see(less, *each, FEW)) for before, each in zip(whole[:count], asked, strict=False)
            )
        except EstimateError:
            return math.inf

    once = FEW * sum(each.seconds for each in whole)
    price("finding out what the result does not feel", once * math.log2(len(scene.effects) + 2))
    felt = [name for name, effect in scene.effects.items() if not isinstance(effect, UNFELT)]
    alone = {name: change([name], 1) for name in felt}
    order = sorted((name for name in felt if alone[name] <= fidelity), key=alone.__getitem__)
    most, least = len(order), 0
    while least < most:  # how many together are too many is found by halving; what is left out was tried as a whole
        middle = (least + most + 1) // 2
        least, most = (middle, most) if change(order[:middle], len(asked)) <= fidelity else (least, middle - 1)
    return leaving_out(scene, order[:least]).at_fidelity(fidelity, order[:least])


def _greatest(whole: Seen, other: Seen) -> float:
    return max(float(each.max()) for each in changes(whole, other))
