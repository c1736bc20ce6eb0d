"""Mode of a piecewise linear system: a linear system with guards that tell how long it lasts; and a stay in a mode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.simulators.linear.lti import Rows, StateSpace, Steady, Trace
from palpate.simulators.linear.periodic import Periodic


@dataclass(frozen=True, eq=False)
class Guard:
    """An output that stays at or above zero while a mode lasts, and the mode that follows when it does not.

    `entry` is a function of state (s,) and inputs (m,) at the end that gives the first state of the following mode;
    None: the state stays.
    """

    row: Rows
    following: Callable[[], Mode]
    entry: Callable[[Floats, Floats], Floats] | None = None


@dataclass(frozen=True, eq=False)
class Mode:
    """A linear system from all inputs to all outputs, valid as long as its guards hold. `touch` tells modes apart."""

    touch: Any
    system: StateSpace
    guards: tuple[Guard, ...] = ()


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stay in one mode, from `start_ns` and a state (s,) to `end_ns`, when a guard fails.

    `traces` keeps the functions of time that were asked for, by name and rows.
    """

    start_ns: int
    end_ns: int
    mode: Mode
    steady: Steady
    state: Floats
    failed: Guard | None
    traces: dict[tuple[str, int, int], Trace] = field(default_factory=dict, init=False)

    def trace(self, name: str, rows: slice, row: Callable[[StateSpace], Rows]) -> Trace:
        """Some of the system's outputs, or functions of them, for all times of the stay."""
        key = (name, rows.start, rows.stop)
        if key not in self.traces:
            self.traces[key] = self.steady.trace(row(self.mode.system), self.start_ns, self.state)
        return self.traces[key]

    def moment(self, time_ns: int) -> Floats:
        """The state (s,) at a time of the stay."""
        return self.steady.moment(self.start_ns, self.state, time_ns)

    def after(self, inputs: tuple[Periodic, ...]) -> tuple[Mode, Floats]:
        """The mode and the state that follow; the same mode where only the search was cut off."""
        state = self.moment(self.end_ns)
        if self.failed is None:
            return self.mode, state
        if self.failed.entry is not None:
            state = self.failed.entry(state, np.array([each.now(self.end_ns) for each in inputs]))
        return self.failed.following(), state
