"""What the sensor nodes of a scene sample, without a bench, each film in the range that a run would set."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from palpate.instrument.contracts.sensor_node import FULL_SCALE_COUNTS, HEADROOM, RANGE_VOLTS
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.sensor_node import SampleBlock, SimulatedSensorNode
from palpate.simulators.linear.lti import Floats, Times
from palpate.simulators.rig.rig import Rig
from palpate.simulators.scenes.scene import Scene

FINEST, WIDEST = RANGE_VOLTS.index(min(RANGE_VOLTS)), RANGE_VOLTS.index(max(RANGE_VOLTS))


def sampled(scene: Scene, rig: Rig, time_ns: Times, period_ns: int) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Samples of each film [V], and whether they are saturated.

    A film has the finest range if that holds what load and amplifiers give, with `HEADROOM`. If noise or hum clip it
    there, it is sampled in the widest range, as a run repeats its point.
    """
    volts = rig.film_voltages(time_ns)
    samples, saturated = np.empty(volts.shape), np.empty(volts.shape, bool)
    for number in range(1, scene.nodes + 1):
        node = SimulatedSensorNode(VirtualClock(), number, number, rig)
        wired = ((i, node.wired(film)) for i, film in enumerate(scene.design.films))
        films = {i: channel for i, channel in wired if channel is not None}
        fits = {i: HEADROOM * np.abs(volts[i]).max() <= min(RANGE_VOLTS) for i in films}
        ranges = {films[i]: FINEST if fine else WIDEST for i, fine in fits.items()}
        at_inputs = node.film_channels @ volts
        taken = _taken(node, ranges, time_ns, at_inputs, period_ns)
        clipped = {channel for channel in ranges if (taken.saturation >> (channel - 1) & 1).any()}
        if any(ranges[channel] != WIDEST for channel in clipped):
            ranges |= dict.fromkeys(clipped, WIDEST)
            again = SimulatedSensorNode(VirtualClock(), number, number, rig)
            taken = _taken(again, ranges, time_ns, at_inputs, period_ns)
        for i, channel in films.items():
            samples[i] = taken.counts[:, channel - 1] * (RANGE_VOLTS[ranges[channel]] / FULL_SCALE_COUNTS)
            saturated[i] = taken.saturation >> (channel - 1) & 1
    return samples, saturated


def _taken(
    node: SimulatedSensorNode, ranges: dict[int, int], time_ns: Times, volts: Floats, period_ns: int
) -> SampleBlock:
    """Samples of a node with these ranges of its channels."""
    for channel, range_ in ranges.items():
        node.settings[f"range_{channel}"] = float(range_)
    return node.sample(time_ns, volts, period_ns)
