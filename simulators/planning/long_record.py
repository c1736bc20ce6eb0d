"""A long record of a tooth's film and its base's film under a settled load, without devices, for `accuracy dwell`.

The gains' scatter is left out of the record and given beside it, because within one load set it is a constant that no
record shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.instrument.sensor.design import FILM_KINDS
from palpate.simulators.linear.lti import Floats
from palpate.simulators.physics.in_order import Effects
from palpate.simulators.planning.plan import LOOKED_AT, Question, driven
from palpate.simulators.planning.samples import sampled
from palpate.simulators.planning.waveforms import SETTLING
from palpate.simulators.scenes.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class LongRecord:
    """Samples of two films.

    Attributes:
        time: (n,) s.
        voltage: (2, n) V, the first tooth's film and its base's.
        saturated: whether a sample was at its rail.
        ratio: true ratio of the two amplitudes, by the sensor and the mounted object alone.
        scatter: relative standard deviation of the ratio from one load set to the next, by the films' gains.
    """

    time: Floats
    voltage: Floats
    saturated: bool
    ratio: float
    scatter: float


def is_followed(scene: Scene, question: Question) -> bool:
    """Whether the scene must be followed from transition to transition, at a millisecond of CPU time each."""
    return bool(driven(scene, question).transitions(round(LOOKED_AT * 1e9)))


def long_record(scene: Scene, question: Question, rate: float) -> LongRecord:
    """The record of a question's load over its dwell, at `rate` samples a second.

    Raises:
        RangeError: the scene's model does not answer for the sample.
    """
    films = scene.design.films
    tooth = next(film for film in films if film.kind == FILM_KINDS[0])
    base = next(film for film in films if film.kind == FILM_KINDS[1] and set(tooth.teeth) <= set(film.teeth))
    pair = [films.index(tooth), films.index(base)]
    effects = Effects(scene.effects)
    kept = replace(scene, effects=effects.but(effects.scattering))
    period_ns = round(1e9 / rate)
    first = round(SETTLING * 1e9) // period_ns
    time_ns = (first + np.arange(round(question.dwell * rate))) * period_ns
    voltage, saturated = sampled(kept, driven(kept, question), time_ns, period_ns)
    touched = {effect.name: effect for effect in (*effects.share, effects.stack) if effect}
    gains = np.abs(driven(replace(scene, effects=touched), question).transfer(question.frequency))[pair]
    strength = (effects.scattering and effects.scattering.scatter) or 0.0
    return LongRecord(
        time=1e-9 * (time_ns - time_ns[0]),
        voltage=voltage[pair],
        saturated=bool(saturated[pair].any()),
        ratio=float(gains[0] / gains[1]),
        scatter=strength * float(np.sqrt(scene.design.tooth_covariance[0][0])),
    )
