"""What the films of a scene give over a dwell, without noise and steps, whatever the phase in which the drive began."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from palpate.simulators.linear.lti import Floats, StateSpace, Times
from palpate.simulators.linear.path import Path
from palpate.simulators.linear.periodic import CYCLE, HERTZ, SECOND, Periodic
from palpate.simulators.physics.parts import Touch

STARTS = 3  # phases in which the drive begins: where the chain is linear, all others follow from them
PHASES = 12 * STARTS
GONE = 30.0  # time constants, after which it does not matter how something began
LIMITS = ("contact", "rail", "current", "stop")

Seen = Callable[[Path, Times, slice], Floats]  # of a path at some times: its outputs, or their rates (films, n)


class Driven(Protocol):
    """A bench whose drive has just been set."""

    @property
    def path(self) -> Path:
        """What follows from the present settings."""

    def path_from(self, phase: int) -> Path:
        """What would follow if the drive had begun so much later in its period [1/CYCLE], all else as it was."""

    def coil_voltage(self) -> Periodic:
        """The voltage at the shaker's coil."""

    def without_limits(self) -> tuple[StateSpace, list[int]]:
        """From the inputs to film voltages and force on the load cell, (films + 1,), where no limit acts and each play
        operator follows its force; and the plays' states."""


@dataclass(frozen=True, eq=False)
class Dwell:
    """The films over a dwell, of a rig whose drive has just been set.

    Attributes:
        times: of the samples (n,) [ns].
        films: how many.
        period: of the drive [ns].
        starts: what follows where the drive begins in each of some phases; where `limited`, up to the first that is.
        linear: nothing changes state up to the dwell's end: not even a play operator moves.
        limited: contact is lost, or a limit acts. Then nothing more is followed.
    """

    times: Times
    films: int
    period: int
    starts: Sequence[Path]
    linear: bool
    limited: bool
    _known: dict[tuple[Seen, bool], Floats] = field(default_factory=dict, init=False)

    def volts(self, linear: bool) -> Floats:
        """Voltages in each phase of the drive (phases, films, n) [V]; `linear`: by superposition."""
        return self._seen(Path.outputs, linear)

    def rates(self, linear: bool) -> Floats:
        """Rates of the same [V/s]."""
        return self._seen(Path.rates, linear)

    def _seen(self, what: Seen, linear: bool) -> Floats:
        if (what, linear) not in self._known:
            self._known[what, linear] = self._superposed(what) if linear else self._shifted(what)
        return self._known[what, linear]

    def _superposed(self, what: Seen) -> Floats:
        """From what begins in each of some phases: a constant, and what turns with the phase."""
        starts = np.stack([what(path, self.times, slice(0, self.films)) for path in self.starts])
        apart = np.arange(PHASES)[:, np.newaxis] / PHASES - np.arange(len(starts)) / len(starts)
        weights = (1 + 2 * np.cos(2 * math.pi * apart)) / len(starts)
        return np.asarray(np.tensordot(weights, starts, 1))

    def _shifted(self, what: Seen) -> Floats:
        """Other phases are what follows a little later."""
        count = PHASES // len(self.starts)
        later = self.times + np.arange(count)[:, np.newaxis] * (self.period // PHASES)
        order = np.argsort(later.ravel(), kind="stable")
        found = np.empty((len(self.starts), self.films, later.size))
        for each, path in zip(found, self.starts, strict=True):
            each[:, order] = what(path, later.ravel()[order], slice(0, self.films))
        by_phase = found.reshape(len(self.starts), self.films, *later.shape).swapaxes(1, 2)
        return by_phase.reshape(PHASES, self.films, len(self.times))


def dwell_of(rig: Driven, films: int, settled: float, dwell: float, rate: float) -> Dwell:
    """`settled` s after the drive was set, for `dwell` s, `rate` samples a second."""
    times = (round(settled * rate) + np.arange(max(1, round(dwell * rate)))) * round(1e9 / rate)
    end_ns = round(1e9 * (settled + dwell))
    frequency = rig.coil_voltage().frequency
    period = SECOND * HERTZ // frequency if frequency else 0
    linear, starts = True, []
    for path in begun(rig, STARTS):
        starts.append(path)
        for touch in touched(path, end_ns):
            if met(touch, LIMITS):
                return Dwell(times, films, period, starts, linear=False, limited=True)
            linear = linear and touch == Touch(drag=(0,) * len(touch.drag))
        if not linear and _settled(rig, films, settled):
            del starts[1:]  # all other phases come later
            break
    return Dwell(times, films, period, starts, linear, limited=False)


def _settled(rig: Driven, films: int, settled: float) -> bool:
    """Whether all that films see but the plays, which forget in a period, has forgotten how the drive began."""
    system, plays = rig.without_limits()
    seen = (system.c[:films] != 0).any(axis=0)
    for _ in range(system.order):
        seen |= seen @ (system.a != 0)
    seen[plays] = False
    return bool((np.linalg.eigvals(system.a[np.ix_(seen, seen)]).real * settled < -GONE).all())


def begun(rig: Driven, starts: int) -> Iterator[Path]:
    """What follows where the drive that was just set begins in each of some phases."""
    yield rig.path
    for start in range(1, starts):
        yield rig.path_from(CYCLE * start // starts)


def touched(path: Path, end_ns: int) -> Iterator[Touch]:
    """All that touches from the beginning up to a time, each as it is found."""
    return (mode.touch for mode in path.modes_met(end_ns))


def met(touch: Touch, names: Sequence[str]) -> bool:
    """Whether any of these limits is met, or contact lost."""
    return any(getattr(touch, name) != getattr(Touch(), name) for name in names)
