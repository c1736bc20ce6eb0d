"""What a scene's films measure, without devices: the samples of a dwell, and force and ratio from them."""

from __future__ import annotations

import numpy as np

from instrument.contracts.sensor_node import RANGE_VOLTS
from instrument.estimate import fit_sine
from simulators.effects.adc import Adc
from simulators.effects.effect import InputEffect
from simulators.linear.lti import Floats
from simulators.planning.plan import RATE, SETTLING, Question, driven
from simulators.randomness import Stream
from simulators.scene import Scene

PERIOD_NS = round(1e9 / RATE)


def volts(scene: Scene, question: Question) -> Floats:
    """Voltages that a node of unlimited resolution would sample, or its converter gives, (films, n)."""
    rig = driven(scene, question)
    first = round(SETTLING * RATE)
    times = np.arange(first, first + round(question.dwell * RATE)) * PERIOD_NS
    signals = rig.film_voltages(times)
    rates = rig.film_rates(times)
    added = np.zeros_like(signals)
    for name, effect in scene.effects.items():
        if isinstance(effect, InputEffect):
            for number in range(len(signals)):
                stream = Stream(scene.seed, name, 1, number, PERIOD_NS)
                added[number] += effect.volts(stream, times, PERIOD_NS, lambda n=number: rates[n])
    converter = scene.effects.get("adc")
    if isinstance(converter, Adc):
        return converter.convert((signals + added) / max(RANGE_VOLTS))[0] * max(RANGE_VOLTS)
    return signals + added


def force_and_ratio(scene: Scene, question: Question) -> tuple[float, float]:
    """Amplitude of the total film's force [N], and the force ratio, by least squares."""
    signals = volts(scene, question)
    fit = fit_sine(np.arange(signals.shape[1]) / RATE, signals, question.frequency)
    films = scene.design.films
    rigid = next(i for i, film in enumerate(films) if film.kind == "rigid")
    total = next(i for i, film in enumerate(films) if film.kind == "total")
    force = float(fit.amplitude[total]) / films[total].sensitivity
    return force, float(fit.amplitude[rigid]) / films[rigid].sensitivity / force
