"""Films of a scene over a dwell, without noise and rounding, for every phase at which the drive may begin."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from palpate.instrument.arrays import Floats, Times
from palpate.simulators.linear.lti import StateSpace
from palpate.simulators.linear.path import Path
from palpate.simulators.linear.periodic import CYCLE, HERTZ, SECOND, Periodic
from palpate.simulators.physics.chain import Touch

STARTS = 3  # phases at which the drive begins; where the chain is linear, all others follow from them
PHASES = 12 * STARTS
ROUNDING = 2 * float(np.finfo(np.float64).eps)  # round-off, as a fraction of the sum of all terms of a voltage
GOLDEN = (math.sqrt(5) - 1) / 2
GONE = 30.0  # time constants after which the beginning no longer matters
LIMITS = ("contact", "rail", "current", "stop")

Seen = Callable[[Path, Times, slice], Floats]  # returns outputs of a path at some times, or their rates (films, n)


class DrivenBench(Protocol):
    """A bench whose drive has just been set."""

    @property
    def path(self) -> Path:
        """The motion that follows from the present settings."""

    def path_from(self, phase: int) -> Path:
        """The motion if the drive had begun later in its period by a phase [1/CYCLE], all else as it was."""

    def coil_voltage(self) -> Periodic:
        """The voltage at the shaker's coil."""

    def without_limits(self) -> tuple[StateSpace, list[int]]:
        """System from the inputs to film voltages and force on the load cell (films + 1,), and its plays' states.

        No limit acts in it, and each play operator follows its force.
        """


@dataclass(frozen=True, eq=False)
class SimulatedDwell:
    """The films over a dwell, of a rig whose drive has just been set.

    Attributes:
        times: (n,), times of the samples [ns].
        films: number of films.
        period: period of the drive [ns].
        starts: motion for each of some phases at which the drive begins; where `limited`, up to the first one that is
            limited.
        linear: whether there is no transition up to the dwell's end, not even of a play operator.
        limited: whether contact is lost or a limit acts; then nothing more is followed.
    """

    times: Times
    films: int
    period: int
    starts: Sequence[Path]
    linear: bool
    limited: bool
    _computed: dict[tuple[Seen, bool], Floats] = field(default_factory=dict, init=False)

    def volts(self, linear: bool) -> Floats:
        """Voltages (phases, films, n) [V] for each phase of the drive; `linear`: by superposition."""
        return self._seen(Path.outputs, linear)

    def rates(self, linear: bool) -> Floats:
        """Rates of these voltages [V/s]."""
        return self._seen(Path.rates, linear)

    def rounding(self) -> Floats:
        """Greatest change of the voltages by round-off, shape (films,) [V]."""
        terms = np.array([path.magnitude(slice(0, self.films)) for path in self.starts])
        return np.asarray(ROUNDING * terms.max(axis=0))

    def _seen(self, what: Seen, linear: bool) -> Floats:
        if (what, linear) not in self._computed:
            self._computed[what, linear] = superposed(self._begun(what)) if linear else self._shifted(what)
        return self._computed[what, linear]

    def at(self, times: Times, linear: bool) -> tuple[Floats, Floats]:
        """Voltages and rates at other ascending times [ns]; `linear`: for the phases that `superposed` needs."""
        other = replace(self, times=times)
        volts, rates = (other._begun(what) if linear else other._shifted(what) for what in (Path.outputs, Path.rates))
        return volts, rates

    def _begun(self, what: Seen) -> Floats:
        """Motion (starts, films, n) for each phase that is followed."""
        return np.stack([what(path, self.times, slice(0, self.films)) for path in self.starts])

    def _shifted(self, what: Seen) -> Floats:
        """Motion for other phases, as the motion a little later.

        Phases are spaced unevenly, because in a cycle of 7.2 samples every fifth of 36 even ones has its samples at the
        same places of the waveform.
        """
        shifts = np.arange(PHASES // len(self.starts))
        later_by = GOLDEN * (shifts % (PHASES // STARTS)) % 1  # this does not depend on the number of starts
        shifts = ((shifts + later_by) * self.period / PHASES).astype(np.int64)
        later = self.times + shifts[:, np.newaxis]
        order = np.argsort(later.ravel(), kind="stable")
        found = np.empty((len(self.starts), self.films, later.size))
        for each, path in zip(found, self.starts, strict=True):
            each[:, order] = what(path, later.ravel()[order], slice(0, self.films))
        by_phase = found.reshape(len(self.starts), self.films, *later.shape).swapaxes(1, 2)
        return by_phase.reshape(PHASES, self.films, len(self.times))


def superposed(starts: Floats) -> Floats:
    """Motion (PHASES, films, n), a constant and a part that turns with the phase, from even phases (p, films, n)."""
    apart = np.arange(PHASES)[:, np.newaxis] / PHASES - np.arange(len(starts)) / len(starts)
    weights = (1 + 2 * np.cos(2 * math.pi * apart)) / len(starts)
    return np.asarray(np.tensordot(weights, starts, 1))


def dwell_of(rig: DrivenBench, films: int, settled: float, dwell: float, rate: float) -> SimulatedDwell:
    """Films over a dwell [s], from `settled` [s] after the drive was set, at `rate` samples a second."""
    times = (round(settled * rate) + np.arange(max(1, round(dwell * rate)))) * round(1e9 / rate)
    end_ns = round(1e9 * (settled + dwell))
    frequency = rig.coil_voltage().frequency
    period = SECOND * HERTZ // frequency if frequency else 0
    linear, starts = True, []
    for path in begun(rig, STARTS):
        starts.append(path)
        for touch in touched(path, end_ns):
            if met(touch, LIMITS):
                return SimulatedDwell(times, films, period, starts, linear=False, limited=True)
            linear = linear and touch == Touch(drag=(0,) * len(touch.drag))
        if not linear and _settled(rig, films, settled):
            del starts[1:]  # the other phases follow from later times
            break
    return SimulatedDwell(times, films, period, starts, linear, limited=False)


def _settled(rig: DrivenBench, films: int, settled: float) -> bool:
    """Whether everything that films see, except plays, has forgotten how the drive began."""
    system, plays = rig.without_limits()
    seen = (system.c[:films] != 0).any(axis=0)
    for _ in range(system.order):
        seen |= seen @ (system.a != 0)
    seen[plays] = False
    return bool((np.linalg.eigvals(system.a[np.ix_(seen, seen)]).real * settled < -GONE).all())


def begun(rig: DrivenBench, starts: int) -> Iterator[Path]:
    """Motion for each of some phases at which the drive that was just set begins."""
    yield rig.path
    for start in range(1, starts):
        yield rig.path_from(CYCLE * start // starts)


def touched(path: Path, end_ns: int) -> Iterator[Touch]:
    """All combinations of what touches, from the beginning up to a time, each as it is found."""
    return (mode.touch for mode in path.modes_met(end_ns))


def met(touch: Touch, names: Sequence[str]) -> bool:
    """Whether any of these limits is met, or contact is lost."""
    return any(getattr(touch, name) != getattr(Touch(), name) for name in names)
