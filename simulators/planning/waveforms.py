"""Waveforms at each stage of a scene's chain over some periods of the drive, without devices."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from palpate.simulators.linear.lti import Floats
from palpate.simulators.physics.in_order import Effects
from palpate.simulators.physics.parts import Armature, Limits
from palpate.simulators.planning.plan import Question, driven
from palpate.simulators.planning.samples import sampled
from palpate.simulators.scenes.scene import Scene

SETTLING = 5.0  # s after the drive was set, as in a load sweep
POINTS = 400  # samples in a period
SAMPLES_PER_CYCLE = 25


@dataclass(frozen=True, slots=True, eq=False)
class Waveforms:
    """Functions of time from the first moment on; films in the order of the design.

    Attributes:
        time: (n,) s.
        coil: voltage at the coil (n,) V.
        force: force on the load cell (n,) N.
        before: films before their amplifiers (films, n) V.
        films: films behind their amplifiers (films, n) V.
        sample_time: (m,) s.
        samples: samples of the nodes (films, m) V.
        saturated: (films, m).
    """

    time: Floats
    coil: Floats
    force: Floats
    before: Floats
    films: Floats
    sample_time: Floats
    samples: Floats
    saturated: npt.NDArray[np.bool_]


def waveforms(scene: Scene, question: Question, periods: int) -> Waveforms:
    """The waveforms of a settled measurement.

    Raises:
        RangeError: the scene's model does not answer for the sample.
    """
    rig = driven(scene, question)
    bare = rig.effects.but(rig.effects.amplifier)
    period_ns = round(1e9 / (SAMPLES_PER_CYCLE * question.frequency))
    first = round(SETTLING * 1e9) // period_ns
    samples_ns = (first + np.arange(periods * SAMPLES_PER_CYCLE + 1)) * period_ns
    time_ns = np.linspace(samples_ns[0], samples_ns[-1], periods * POINTS + 1).astype(np.int64)
    samples, saturated = sampled(scene, rig, samples_ns, period_ns)
    return Waveforms(
        time=1e-9 * (time_ns - time_ns[0]),
        coil=_clipped(rig.effects, rig.coil_voltage().at(time_ns)),
        force=rig.cell_force(time_ns),
        before=driven(replace(scene, effects=bare), question).film_voltages(time_ns),
        films=rig.film_voltages(time_ns),
        sample_time=1e-9 * (samples_ns - time_ns[0]),
        samples=samples,
        saturated=saturated,
    )


def _clipped(effects: Effects, volts: Floats) -> Floats:
    """Voltage clipped at the amplifier's rail."""
    armature, limits = Armature(1.0, 1.0, 1.0), Limits()
    for effect in effects.shaker:
        armature, limits = effect.shaker(armature, limits)
    return volts if limits.rail is None else np.clip(volts, -limits.rail, limits.rail)
