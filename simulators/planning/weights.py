"""What the effects of a scene change and what they cost, measured: its films with an effect and without it.

    weigh(read_scene("noisy_lab"), Question())

Both sides have the same seed, so the same noise and scatter. A bound (`bounds`) says how much an effect could change at
most; this says how much it does change in a few draws.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.instrument import notice
from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError
from palpate.instrument.sensor.design import FILM_KINDS
from palpate.instrument.signals.estimate import fit_sine
from palpate.simulators.bounds.changes import pairs_of
from palpate.simulators.effects import effect_class
from palpate.simulators.physics.in_order import rival
from palpate.simulators.physics.stages import CanEffect, CellEffect, LineEffect
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.prices import PriceLine, Progress, timed
from palpate.simulators.planning.waveforms import SAMPLES_PER_CYCLE, films_sampled
from palpate.simulators.scenes.scene import LARGEST_SEED, Scene

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
    known = [(each.change, each.name) for each in weights if each.change is not None and each.name in scene.effects]
    order = [name for _, name in sorted(known)]
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
    amplitudes, seconds = [], []
    for draw in range(draws):
        begun = time.process_time()
        seeded = scene.with_seed((scene.seed + draw) % (LARGEST_SEED + 1))
        times, volts = films_sampled(seeded, question, question.dwell, start)
        seconds.append(time.process_time() - begun)
        amplitudes.append(fit_sine(times, volts, question.frequency).amplitude)
    found = np.array(amplitudes)
    if not (found[:, bases] > 0).all():
        raise EstimateError(f"scene {scene.name}: a film under a base shows no amplitude; give a larger --load")
    ratios = np.stack([found[:, tooth] / found[:, base] for tooth, base in pairs], axis=1)
    return Seen(found[:, bases], ratios, min(seconds))


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
