"""What will impair a measurement of a scene: films that a converter cuts off, or hardly sees."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from palpate.instrument.contracts.sensor_node import HEADROOM, RANGE_VOLTS
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.planning.samples import sampled
from palpate.simulators.rig.rig import Rig
from palpate.simulators.scenes.scene import Scene

FILMS_SETTLED, FILMS_LOOKED_AT = 2.0, 1.0  # s after the drive was set when films are looked at, and how long
SIGNAL_STEPS, NOISE_STEPS = 20.0, 0.5


def impairments(scene: Scene, rig: Rig, pressed: Sample, load: float, rate: float) -> list[str]:
    """A line for each film that exceeds its converter's widest range, and one for a rigid film of hardly a step.

    Args:
        scene: the scene.
        rig: its rig, driven with the load.
        pressed: the sample.
        load: the load, peak to peak [N].
        rate: samples per second.
    """
    period_ns = round(1e9 / rate)
    time_ns = period_ns * np.arange(round(FILMS_SETTLED * rate), round((FILMS_SETTLED + FILMS_LOOKED_AT) * rate))
    _, saturated = sampled(scene, rig, time_ns, period_ns)
    return [*_clipped(scene.design, saturated), *_in_steps(scene, pressed, load, rate)]


def _clipped(design: Design, saturated: npt.NDArray[np.bool_]) -> list[str]:
    return [
        f"film {film.name!r}: its voltage exceeds the widest range of the converter, {max(RANGE_VOLTS):g} V: points"
        " are clipped and not used; take a smaller load, or weaker effects"
        for film, clipped in zip(design.films, saturated, strict=True)
        if clipped.any()
    ]


def _in_steps(scene: Scene, pressed: Sample, load: float, rate: float) -> list[str]:
    """A rigid film of few of a converter's steps, without noise to dither it, cannot be averaged."""
    rigid = next(film for film in scene.design.films if film.kind == "rigid")
    amplitude = rigid.sensitivity * scene.answer(pressed).force_ratio * load / 2
    fits = HEADROOM * amplitude <= min(RANGE_VOLTS)
    step = 2 * (min if fits else max)(RANGE_VOLTS) / 2**16
    noise = math.hypot(*(effect.dither(rate) for effect in scene.effects.values()))
    if amplitude < SIGNAL_STEPS * step and noise < NOISE_STEPS * step:
        return [
            f"film {rigid.name!r}: amplitude {show(amplitude, 'V', 3)} is {amplitude / step:.2g} steps of the"
            f" converter, below {SIGNAL_STEPS:g}, and noise of {show(noise, 'V', 2)} is below half a step: steps do not"
            " average out; take a larger load, or noise"
        ]
    return []
