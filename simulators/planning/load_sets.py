"""A sweep of loads on a scene in closed form, without devices: the nodes' samples of each settled load set.

The load is not set by the load cell. The drive is computed from the scene's own transfer function.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.instrument.errors import RangeError
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.clock import VirtualClock
from palpate.simulators.linear.lti import Floats
from palpate.simulators.linear.periodic import HERTZ, Periodic
from palpate.simulators.planning.plan import CLOSED_FORM, PRELOAD, moves, path_of
from palpate.simulators.planning.samples import sampled
from palpate.simulators.planning.steady import SETTLED
from palpate.simulators.planning.waveforms import SAMPLES_PER_CYCLE
from palpate.simulators.rig.rig import Rig
from palpate.simulators.scenes.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class LoadSet:
    """Films of the design under one load.

    Attributes:
        load: load, peak to peak [N].
        time: (n,) s, from the first sample on.
        voltage: (films, n) V.
        saturated: (films, n).
    """

    load: float
    time: Floats
    voltage: Floats
    saturated: npt.NDArray[np.bool_]


def load_sets(
    scene: Scene, sample: Sample, loads: Sequence[float], frequency: float, dwell: float
) -> Iterator[LoadSet]:
    """Each load in turn: the drive is set, settles, and the films are sampled 25 times a cycle over the dwell.

    Before a load that is repeated the drive goes off for a cycle, so that each repetition is a load set of its own.

    Args:
        scene: the scene.
        sample: the mounted sample.
        loads: loads, peak to peak [N].
        frequency: frequency of the drive [Hz].
        dwell: dwell [s].

    Raises:
        RangeError: the scene has faults or a limit acts, so that there is no closed form; or its model does not answer
            for the sample.
    """
    if scene.faults:
        raise RangeError(f"scene {scene.name!r} has faults, which only a bench meets; take how = 'bench'")
    clock = VirtualClock()
    rig = Rig(scene, clock)
    clock.add(rig)
    rig.mount(sample)
    stiffness = scene.answer(sample).stiffness
    pressed = PRELOAD * max(loads) * (1 / stiffness + 1 / scene.rig.suspension_stiffness)
    rig.set_position(scene.rig.sensor_position - sample.thickness + pressed)
    period_ns = round(1e9 / (SAMPLES_PER_CYCLE * frequency))

    def drive(volts: float) -> None:
        sine = np.array([-1j * volts])
        rig.set_voltage(Periodic(0.0, round(frequency * HERTZ), clock.now_ns(), 0, np.array([1]), sine))

    for before, load in zip((0.0, *loads), loads, strict=False):
        if load == before:
            drive(0.0)
            clock.wait(1 / frequency)
        drive(load / 2 / abs(rig.transfer(frequency)[-1]))
        clock.wait(SETTLED)
        first = -(-clock.now_ns() // period_ns)
        time_ns = (first + np.arange(round(dwell * 1e9 / period_ns))) * period_ns
        path, why = path_of(moves(rig, int(time_ns[-1])), steady=False)
        if path != CLOSED_FORM:
            raise RangeError(f"scene {scene.name!r} has no closed form under {load:g} N: {why}; take how = 'bench'")
        voltage, saturated = sampled(scene, rig, time_ns, period_ns)
        yield LoadSet(load, 1e-9 * (time_ns - time_ns[0]), voltage, saturated)
        clock.wait(dwell)
