"""What the films of a scene give over a dwell, without noise and steps, whatever the phase in which the drive began."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from simulators.linear.lti import Floats, Times
from simulators.linear.periodic import CYCLE, HERTZ, SECOND
from simulators.physics.chain import Touch
from simulators.rig import Rig

STARTS = 3  # phases in which the drive begins: where the chain is linear, all others follow from them
PHASES = 12 * STARTS
GONE = 30.0  # time constants, after which it does not matter how something began
LIMITS = ("contact", "rail", "current", "stop")


@dataclass(frozen=True, eq=False)
class Dwell:
    """The films over a dwell, of a rig whose drive has just been set.

    Attributes:
        times: of the samples (n,) [ns].
        linear: nothing changes state up to the dwell's end: not even a play operator moves.
        limited: contact is lost, or a limit acts.
        kept: what was followed, voltages and rates (2, phases, films, n) [V, V/s].
    """

    rig: Rig
    times: Times
    linear: bool
    limited: bool
    kept: Floats

    def volts(self, linear: bool) -> Floats:
        """Voltages in each phase of the drive (phases, films, n) [V]; `linear`: by superposition."""
        volts: Floats = (self.kept if linear else self._followed)[0]
        return volts

    def rates(self, linear: bool) -> Floats:
        """Rates of the same [V/s]."""
        rates: Floats = (self.kept if linear else self._followed)[1]
        return rates

    @functools.cached_property
    def _followed(self) -> Floats:
        """Where the chain is linear, for a comparison with another that is not."""
        if not self.linear:
            return self.kept
        starts = [_shifted(self.rig, self.times, PHASES // STARTS) for _ in begun(self.rig, STARTS)]
        return np.concatenate(starts, axis=1)


def dwell_of(rig: Rig, settled: float, dwell: float, rate: float) -> Dwell:
    """`settled` s after the drive was set, for `dwell` s, `rate` samples a second."""
    times = (round(settled * rate) + np.arange(max(1, round(dwell * rate)))) * round(1e9 / rate)
    end_ns = round(1e9 * (settled + dwell))
    starts: list[Floats] = []
    for _ in begun(rig, STARTS):
        if _moved(touched(rig, end_ns)):
            break
        starts.append(_seen(rig, times))
    else:
        return Dwell(rig, times, True, False, _superposed(np.stack(starts)))
    limited, starts = False, []
    count = 1 if _settled(rig, settled) else STARTS
    for _ in begun(rig, count):
        limited = limited or met(touched(rig, end_ns), LIMITS)
        starts.append(_shifted(rig, times, PHASES // count))
    return Dwell(rig, times, False, limited, np.concatenate(starts, axis=1))


def _moved(found: Sequence[Touch]) -> bool:
    return any(touch != Touch(drag=(0,) * len(touch.drag)) for touch in found)


def _settled(rig: Rig, settled: float) -> bool:
    """Whether all but the plays, which forget in a period, has forgotten how the drive began."""
    system, plays = rig.without_limits()
    others = np.delete(np.delete(system.a, plays, axis=0), plays, axis=1)
    return bool((np.linalg.eigvals(others).real * settled < -GONE).all())


def _seen(rig: Rig, times: Times) -> Floats:
    """Voltages and rates (2, films, n)."""
    return np.stack([rig.film_voltages(times), rig.film_rates(times)])


def _shifted(rig: Rig, times: Times, count: int) -> Floats:
    """The same a little later, which is in another phase (2, count, films, n)."""
    frequency = rig.coil_voltage().frequency
    period = SECOND * HERTZ // frequency if frequency else 0
    later = times + np.arange(count)[:, np.newaxis] * (period // PHASES)
    order = np.argsort(later.ravel(), kind="stable")
    found = np.empty((2, len(rig.scene.design.films), later.size))
    found[..., order] = _seen(rig, later.ravel()[order])
    return found.reshape(2, -1, *later.shape).swapaxes(1, 2)


def begun(rig: Rig, starts: int) -> Iterator[None]:
    """The drive that was just set, begun in each of some phases."""
    voltage = rig.coil_voltage()
    try:
        yield
        for start in range(1, starts):
            rig.set_voltage(replace(voltage, start_phase=(voltage.start_phase + CYCLE * start // starts) % CYCLE))
            yield
    finally:
        if rig.coil_voltage() is not voltage:
            rig.set_voltage(voltage)


def touched(rig: Rig, end_ns: int) -> list[Touch]:
    """What touches as the drive begins, and after each transition up to a time."""
    return [rig.touch(), *(after for _, after in rig.transitions(end_ns))]


def met(touches: Sequence[Touch], names: Sequence[str]) -> bool:
    """Whether any of these limits is met, or contact lost."""
    return any(getattr(touch, name) != getattr(Touch(), name) for touch in touches for name in names)


def _superposed(starts: Floats) -> Floats:
    """By phase, from (starts, ...): a constant, and what turns with the phase."""
    apart = np.arange(PHASES)[:, np.newaxis] / PHASES - np.arange(len(starts)) / len(starts)
    weights = (1 + 2 * np.cos(2 * math.pi * apart)) / len(starts)
    return np.asarray(np.tensordot(weights, starts, 1)).swapaxes(0, 1)
