"""Motion of a piecewise linear system from one change of its settings to the next.

A mode is a linear system with guards: outputs that stay at or above zero while it lasts. Where a guard fails, the next
mode begins with the state that the last one left. Inside a mode everything is known in closed form, even whether a
guard can ever fail. Only where a guard may fail, its first failure is searched for.

Once the guards see the same in two periods of the drive, every later period has the same transitions. From then on
nothing is searched for, and any later moment is reached without following the time before it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.errors import UnreachableError
from palpate.simulators.linear.crossing import NEVER, CrossingWatch
from palpate.simulators.linear.cycle import Cycle, Mode, PoincareSection, Recurrence, Stretch, depended_on, recurrence
from palpate.simulators.linear.free_motion import kept_motion
from palpate.simulators.linear.lti import KEPT, Rows, StateSpace, Steady, led_to
from palpate.simulators.linear.periodic import CYCLE, HERTZ, SECOND, Periodic

LONGEST = 100 * SECOND  # time in which the transitions of a drive at rest are counted
KEPT_NS = 12 * SECOND  # time for which stretches are kept; the indicator looks back 10 s at most
MOST = 4000  # greatest number of transitions in one period of the drive


@dataclass(frozen=True, eq=False)
class _ModeMotion:
    """Results that are computed once for a mode: periodic state, and the system of the states that guards see."""

    mode: Mode
    steady: Steady
    seen: list[int]
    watch: CrossingWatch


class Path:
    """The stretches since a change. They are computed as far as somebody asks; results do not depend on who asks when.

    Args:
        inputs: (m,) periodic functions of time that start at the change, all with the period of the first.
        mode: mode at the change.
        state: (s,), state at the change.
        check: called before each transition; it may raise, to give up.
    """

    def __init__(
        self,
        inputs: tuple[Periodic, ...],
        mode: Mode,
        start_ns: int,
        state: Floats,
        check: Callable[[], object] = lambda: None,
    ) -> None:
        self._check = check
        self._inputs = inputs
        self._motions: dict[int, _ModeMotion] = {}
        self.start_ns = start_ns
        frequency = inputs[0].frequency
        self._period = SECOND * HERTZ // frequency if frequency else LONGEST
        self._largest = np.abs(state)
        self._section: PoincareSection | None = None
        self._recurrence: Recurrence | None = None
        self.cycle: Cycle | None = None
        self._crowd = (start_ns, 0)
        self.stretches: list[Stretch] = []
        self._first = mode, start_ns, state  # entered when somebody asks

    def outputs(self, time_ns: Times, rows: slice, step_ns: int = 0) -> Floats:
        """Some of the outputs (rows, n) at ascending times from the change on, all `step_ns` apart or 0."""

        def row(system: StateSpace) -> Rows:
            return system.c[rows], system.d[rows]

        return self._collect("outputs", rows, row, time_ns, step_ns)

    def rates(self, time_ns: Times, rows: slice, step_ns: int = 0) -> Floats:
        """Rates of some of the outputs (rows, n) [1/s] at ascending times from the change on, all `step_ns` apart."""

        def row(system: StateSpace) -> Rows:
            # Only the first input changes; the last one is its rate.
            direct = np.outer(system.d[rows, 0], [0.0] * (len(self._inputs) - 1) + [1.0])
            return system.c[rows] @ system.a, system.c[rows] @ system.b + direct

        return self._collect("rates", rows, row, time_ns, step_ns)

    def magnitude(self, rows: slice) -> Floats:
        """Sums (rows,) of the sizes of all terms that make up outputs in the first mode, which tell their rounding."""
        mode, start_ns, state = self._first
        return self._motion(mode).steady.magnitude((mode.system.c[rows], mode.system.d[rows]), start_ns, state)

    def state(self, time_ns: int) -> Floats:
        """The state (s,) at a time from the change on."""
        cycle = self._recurring(time_ns)
        return cycle.state(time_ns) if cycle else self.between(time_ns, time_ns)[-1].moment(time_ns)

    def mode_at(self, time_ns: int) -> Mode:
        """The mode at a time from the change on."""
        cycle = self._recurring(time_ns)
        return cycle.mode_at(time_ns) if cycle else self.between(time_ns, time_ns)[-1].mode

    def modes_until(self, time_ns: int) -> list[Mode]:
        """Modes of the last 12 s up to a time, one after the other."""
        first_ns = max(self.start_ns, time_ns - KEPT_NS)
        cycle, modes = self._recurring(time_ns), []
        if cycle is None or first_ns < cycle.start_ns:
            last_ns = time_ns if cycle is None else cycle.start_ns - 1
            modes += [stay.mode for stay in self.between(first_ns, last_ns)]
        if cycle is not None:
            modes += cycle.modes(max(first_ns, cycle.start_ns), time_ns)
        return [modes[0], *(after for before, after in pairwise(modes) if after is not before)]

    def modes_met(self, time_ns: int) -> Iterator[Mode]:
        """All modes from the change up to a time, one after the other; two periods of those that recur.

        The mode that follows is searched for only when it is asked for, so that a caller can stop early.
        """
        now_ns = self.start_ns
        self._recurring(now_ns)
        number = max(bisect_right(self.stretches, now_ns, key=_start) - 1, 0)
        while now_ns <= time_ns and self._recurring(now_ns) is None:
            stay = self.stretches[number]
            yield stay.mode
            now_ns, number = stay.end_ns, number + 1
        cycle = self._recurring(time_ns)
        if cycle is not None:
            yield from cycle.modes(cycle.start_ns, min(time_ns, cycle.start_ns + 2 * self._period))

    def _collect(
        self, name: str, rows: slice, row: Callable[[StateSpace], Rows], time_ns: Times, step_ns: int
    ) -> Floats:
        cycle, pieces = self._recurring(int(time_ns[-1])), []
        border = len(time_ns) if cycle is None else int(time_ns.searchsorted(cycle.start_ns))
        followed, recurring = time_ns[:border], time_ns[border:]
        if len(followed):
            stays = self.between(int(followed[0]), int(followed[-1]))
            for stay, part in zip(stays, split(followed, [stay.start_ns for stay in stays[1:]]), strict=True):
                if len(part):
                    pieces.append(stay.trace(name, rows, row).at(part, step_ns))
        if len(recurring) and cycle is not None:
            pieces.append(cycle.at(name, rows, row, recurring, step_ns))
        return pieces[0] if len(pieces) == 1 else np.concatenate(pieces, axis=1)

    def _recurring(self, last_ns: int) -> Cycle | None:
        """The recurring motion at a time; None: nothing recurs then."""
        if not self.stretches:
            self._enter(*self._first)
        while self.cycle is None and self.stretches[-1].end_ns <= last_ns:
            self._follow()
        return self.cycle if self.cycle is not None and last_ns >= self.cycle.start_ns else None

    def between(self, first_ns: int, last_ns: int) -> list[Stretch]:
        """The stretches that hold the times from the first to the last, which have been followed."""
        kept_ns = min(first_ns, last_ns - KEPT_NS)
        if self._section is not None:
            kept_ns = min(kept_ns, self._section.time_ns)
        stays = self.stretches
        del stays[: max(bisect_right(stays, kept_ns, key=_start) - 1, 0)]
        low = max(bisect_right(stays, first_ns, key=_start) - 1, 0)
        return stays[low : max(bisect_right(stays, last_ns, key=_start), low + 1)]

    # --- transitions -----------------------------------------------------------------------------------

    def _follow(self) -> None:
        """Compute the stretch after the last one."""
        self._check()
        last = self.stretches[-1]
        mode, state = last.after(self._inputs)
        if mode is not last.mode:
            since_ns, count = self._crowd
            self._crowd = (since_ns, count + 1) if last.end_ns - since_ns <= self._period else (last.end_ns, 1)
            if count > MOST:
                raise UnreachableError(
                    f"the simulated chain changes state more than {MOST} times in one period of its drive, at"
                    f" {last.end_ns / SECOND:.9f} s from {last.mode.touch} to {mode.touch}; take a softer stop, more"
                    " damping, or limits that are further apart"
                )
        self._enter(mode, last.end_ns, state)

    def _enter(self, mode: Mode, start_ns: int, state: Floats) -> None:
        mechanics = self._motion(mode)
        self._largest = np.maximum(self._largest, np.abs(state))
        end_ns, failed = mechanics.watch.first_failure(start_ns, state[mechanics.seen])
        guard = None if failed is None else mode.guards[failed]
        self.stretches.append(Stretch(start_ns, end_ns, mode, mechanics.steady, state, guard))
        if self._inputs[0].frequency:
            self._look_for_repeat(self.stretches[-1])

    def _motion(self, mode: Mode) -> _ModeMotion:
        if id(mode) not in self._motions:
            system, count = mode.system, len(mode.guards)
            states = np.array([guard.row[0][0] for guard in mode.guards]).reshape(count, system.order)
            inputs = np.array([guard.row[1][0] for guard in mode.guards]).reshape(count, len(self._inputs))
            shape = count, system.order, len(self._inputs)
            seen, by_itself = _by_itself(system.a.tobytes(), system.b.tobytes(), states.tobytes(), shape)
            watch = CrossingWatch(by_itself.drive(self._inputs), (states[:, seen], inputs))
            self._motions[id(mode)] = _ModeMotion(mode, system.drive(self._inputs), seen, watch)
        return self._motions[id(mode)]

    def _look_for_repeat(self, stay: Stretch) -> None:
        """Compare the states of successive periods of the drive in a new stretch."""
        frequency = self._inputs[0].frequency
        number = -(-(stay.start_ns - self.start_ns) * frequency // CYCLE)
        time_ns = self._repeated_ns(number)
        if time_ns >= stay.end_ns:
            return
        before, now = self._section, PoincareSection(number, time_ns, stay)
        if self._recurrence is not None and number >= self._recurrence.number:
            self.cycle, self._recurrence = self._recurrence.begun(now), None
        elif self._recurrence is None and before and before.number + 1 == number and before.stay is not stay:
            within = self.stretches[self.stretches.index(before.stay) :]
            self._recurrence = recurrence(before, now, within, self._largest, self._watch)
        if self.cycle is None and stay.end_ns < NEVER:
            number = (stay.end_ns - 1 - self.start_ns) * frequency // CYCLE
            self._section = PoincareSection(number, self._repeated_ns(number), stay)

    def _repeated_ns(self, number: int) -> int:
        """The first nanosecond after so many periods of the drive."""
        return self.start_ns - (-number * CYCLE // self._inputs[0].frequency)

    def _watch(self, mode: Mode) -> tuple[CrossingWatch, list[int]]:
        mechanics = self._motion(mode)
        return mechanics.watch, mechanics.seen


@lru_cache(maxsize=KEPT)
def _by_itself(a: bytes, b: bytes, rows: bytes, shape: tuple[int, int, int]) -> tuple[list[int], StateSpace]:
    """The states on which some rows depend, and the system of these states alone, without outputs.

    `shape` is the number of rows, states and inputs.
    """
    count, order, inputs = shape
    matrix = np.frombuffer(a).reshape(order, order)
    seen = depended_on((np.frombuffer(rows).reshape(count, order) != 0).any(axis=0), matrix != 0)
    push = np.frombuffer(b).reshape(order, inputs)
    return seen, StateSpace(matrix, push, np.zeros((0, order)), np.zeros((0, inputs))).part(seen)


def _start(stay: Stretch) -> int:
    return stay.start_ns


def split(time_ns: Times, starts_ns: Sequence[int]) -> list[Times]:
    """Divide ascending times at some starts. (numpy's own function takes seven times as long.)"""
    borders = [0, *time_ns.searchsorted(starts_ns).tolist(), len(time_ns)]
    return [time_ns[first:end] for first, end in pairwise(borders)]


def forget() -> None:
    """Drop what is kept of systems from one path to the next, so that a path is found as if its system were new."""
    for kept in (_by_itself, led_to, kept_motion):
        kept.cache_clear()
