"""The physical chain of a scene as linear systems: coil, armature, stack, films, amplifiers, load cell.

    coil voltage -> current -> armature on its suspension -> probe on sample and sensor -> films -> amplifiers
                                                                                        `-> load cell -> filter

Inputs of every mode are the coil voltage, the constant 1, and the rate of the coil voltage. Outputs are the films'
voltages, the filtered and the plain force on the load cell, the compression of the stack, and the armature's
displacement. Modes differ in what touches: the probe and the sample, the armature and a stop, the drive and its limits.

A sample is pressed and never pulled. It leaves the probe where its force passes zero. If it creeps, that is before its
compression passes zero; then it relaxes free of force, and the probe meets it again where its surface is by then.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.simulators.linear.cycle import Guard, Mode
from palpate.simulators.linear.lti import Rows, StateSpace, first_order_low_pass, gain

# --- parts ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Touch:
    """The limits of the chain that are reached: -1 the lower one, 0 none, 1 the upper one.

    `contact` tells whether probe and sample touch over the tooth and over the ring. `drag` tells of each play operator:
    -1 dragged down, 0 at rest, 1 dragged up.
    """

    contact: tuple[bool, bool] = (True, True)
    rail: int = 0
    current: int = 0
    stop: int = 0
    drag: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of drive and armature; None: there is none.

    Attributes:
        rail: greatest voltage of the amplifier [V].
        current: greatest current in the coil [A].
        stop: greatest displacement of the armature [m].
    """

    rail: float | None = None
    current: float | None = None
    stop: float | None = None
    stop_stiffness: float = 1e6


@dataclass(frozen=True, eq=False)
class Armature:
    """The shaker: force constant [N/A], resistance [ohm], suspension [N/m]; with inertia where `mass` is given.

    inductance [H], mass [kg], damping [N s/m].
    """

    force_constant: float
    resistance: float
    suspension: float
    inductance: float = 0.0
    mass: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True, eq=False)
class SpringStack:
    """Sample and sensor as springs: the tooth's branch is the object alone, the ring's is object and ring in series.

    tooth, ring: stiffness of the branches [N/m], each summed over the teeth. object_share: the part of the ring
    branch's compliance that is the object's.
    """

    tooth: float
    ring: float
    object_share: float

    def elastic(self) -> StateSpace:
        """System from the compressions over tooth and ring [m] to the forces on them [N]."""
        return gain(np.diag([self.tooth, self.ring]))


@dataclass(frozen=True, eq=False)
class Plays:
    """Play operators z on a force x: z stays until x is farther than a radius away, and then is dragged.

    Attributes:
        ring: whether x is the force on tooth and ring, not on the tooth alone.
        radii: radii [N].
        weights: weights of h = sum of weights times z.

    """

    ring: bool
    radii: tuple[float, ...]
    weights: tuple[float, ...]


# --- mechanics -----------------------------------------------------------------------------------------


INPUTS = 3  # coil voltage [V], 1, rate of the coil voltage [V/s]


class Mechanics:
    """Systems from the inputs to forces on tooth and ring, compression, displacement, 1 and the current.

    Args:
        armature, limits: armature and limits of the shaker.
        stack: system from the compressions over tooth and ring [m] to the forces on them [N]; neither acts on the
            other.
        advance: distance of the probe past the point where it meets the sample [m].
    """

    def __init__(self, armature: Armature, limits: Limits, stack: StateSpace, advance: float) -> None:
        self._armature, self._limits, self._stack, self._advance = armature, limits, stack, advance

    def system(self, touch: Touch) -> StateSpace:
        """The system while exactly this touches."""
        return self._dynamic(touch) if self._armature.mass else self._quasi_static(touch)

    def parting(self) -> list[list[int]]:
        """Groups of columns that part from the probe together: tooth (0) and ring (1) alone, or both without creep."""
        creeping = self._stack.order and (self._stack.d.diagonal() > 0).all()
        return [[0], [1]] if creeping else [[0, 1]]

    def pressing(self, columns: list[int], compression: Rows) -> Rows:
        """Rows of the force on some columns; where they do not touch, of the negative force if they did."""
        stiffness = float(self._stack.d.diagonal()[columns].sum())
        state = stiffness * compression[0]
        state[: self._stack.order] += self._stack.c[columns].sum(axis=0)
        return state, stiffness * compression[1]

    def _springs(self, touch: Touch) -> tuple[float, float]:
        """Stiffness of suspension and stop [N/m], and the force of the stop at rest [N]."""
        stiffness, push = self._armature.suspension, 0.0
        if touch.stop and self._limits.stop is not None:
            stiffness += self._limits.stop_stiffness
            push = touch.stop * self._limits.stop_stiffness * self._limits.stop
        return stiffness, push

    def voltage(self, touch: Touch) -> Floats:
        """Weights on the inputs of the voltage that the amplifier gives."""
        if touch.rail and self._limits.rail is not None:
            return np.array([0.0, touch.rail * self._limits.rail, 0.0])
        return np.array([1.0, 0.0, 0.0])

    def _pressed(self, touch: Touch) -> StateSpace:
        """System from the probe's distance past a resting sample's surface [m] to the forces on tooth and ring [N].

        A column that does not touch the probe is free of force and relaxes.
        """
        stack = self._stack
        touching = np.array(touch.contact)
        stiffness = stack.d.diagonal()
        free = -stack.c / np.where(stiffness > 0, stiffness, 1.0)[:, np.newaxis]
        free[touching] = 0.0
        return StateSpace(
            stack.a + stack.b @ free,
            stack.b @ touching[:, np.newaxis],
            np.where(touching[:, np.newaxis], stack.c, 0.0),
            (stiffness * touching)[:, np.newaxis],
        )

    def _quasi_static(self, touch: Touch) -> StateSpace:
        """The system without inertia, in which all forces balance."""
        stack = self._pressed(touch)
        voltage = self.voltage(touch)
        current = voltage / self._armature.resistance
        if touch.current and self._limits.current is not None:
            current = np.array([0.0, touch.current * self._limits.current, 0.0])
        stiffness, push = self._springs(touch)
        pushed = self._armature.force_constant * current + np.array([0.0, push, 0.0])
        one = np.array([0.0, 1.0, 0.0])
        # The stack's force is the sum of C z + D compression, and compression is displacement + advance.
        direct = float(stack.d.sum())
        by_input = (pushed - direct * self._advance * one) / (stiffness + direct)
        by_state = -stack.c.sum(axis=0) / (stiffness + direct)
        compression = by_input + self._advance * one
        return StateSpace(
            stack.a + np.outer(stack.b[:, 0], by_state),
            np.outer(stack.b[:, 0], compression),
            np.vstack(
                [
                    stack.c + np.outer(stack.d[:, 0], by_state),
                    by_state,
                    by_state,
                    0 * by_state,
                    0 * by_state,
                ]
            ),
            np.vstack([np.outer(stack.d[:, 0], compression), compression, by_input, one, current]),
        )

    def _dynamic(self, touch: Touch) -> StateSpace:
        """The system with inertia: L i' = u - R i - Bl v, m v' = Bl i - c v - k x - F.

        States: those of the stack, then i, x, v.
        """
        stack, arm = self._pressed(touch), self._armature
        n = stack.order
        stiffness, push = self._springs(touch)
        a, b = np.zeros((n + 3, n + 3)), np.zeros((n + 3, INPUTS))
        i, x, v = n, n + 1, n + 2
        a[:n, :n] = stack.a
        a[:n, x] = stack.b[:, 0]
        b[:n, 1] = stack.b[:, 0] * self._advance
        if not (touch.current and self._limits.current is not None):
            a[i, i], a[i, v] = -arm.resistance / arm.inductance, -arm.force_constant / arm.inductance
            b[i] = self.voltage(touch) / arm.inductance
        a[x, v] = 1.0
        direct = float(stack.d.sum())
        a[v, :n] = -stack.c.sum(axis=0) / arm.mass
        a[v, i], a[v, v] = arm.force_constant / arm.mass, -arm.damping / arm.mass
        a[v, x] = -(stiffness + direct) / arm.mass
        b[v, 1] = (push - direct * self._advance) / arm.mass
        c, d = np.zeros((6, n + 3)), np.zeros((6, INPUTS))
        c[:2, :n] = stack.c
        c[:2, x] = stack.d[:, 0]
        d[:2, 1] = stack.d[:, 0] * self._advance
        c[2, x], d[2, 1] = 1.0, self._advance
        c[3, x] = 1.0
        d[4, 1] = 1.0
        c[5, i] = 1.0
        return StateSpace(a, b, c, d)


# --- the chain -----------------------------------------------------------------------------------------


class MeasuringChain:
    """The modes of one setting of the bench: a mounted sample, a position, gains.

    Args:
        armature, limits: armature and limits of the shaker.
        stack: system from the compressions over tooth and ring [m] to the forces on them [N], both summed over teeth;
            neither acts on the other.
        advance: distance of the probe past the point where it meets the sample [m].
        before: system from the forces on tooth and ring, the plays' force h and the constant 1 to the films' voltages
            before their amplifiers.
        amplifiers: one for each film.
        offsets: offsets of the amplifiers' outputs, shape (films,) [V].
        bridge_tau: time constant of the load cell's filter [s].
        weight: dead weight on the load cell [N].
    """

    def __init__(
        self,
        armature: Armature,
        limits: Limits,
        stack: StateSpace,
        advance: float,
        plays: Plays,
        before: StateSpace,
        amplifiers: list[StateSpace],
        offsets: Floats,
        bridge_tau: float,
        weight: float,
    ) -> None:
        self._armature, self._limits = armature, limits
        self._mechanics = Mechanics(armature, limits, stack, advance)
        self._plays = plays
        self.plays = len(plays.radii)
        constant = np.outer(offsets, [0.0, 0.0, 0.0, 1.0])
        films = before.then(functools.reduce(StateSpace.beside, amplifiers)).plus(gain(constant))
        self._after = _fan_out(films, bridge_tau, weight)
        # Modes refer back to the chain. Whoever uses a mode holds it, so that no cycle has to wait for the garbage
        # collector.
        self._modes: WeakValueDictionary[Touch, Mode] = WeakValueDictionary()
        # These are indices of outputs and states, which other modules use.
        self.bridge = len(amplifiers)
        self.force, self.compression, self.displacement, self.current = range(self.bridge + 1, self.bridge + 5)
        self.stack_order = stack.order  # the stack's states come first
        self._mechanical = stack.order + (3 if armature.mass else 0)
        self.play_states = range(self._mechanical, self._mechanical + self.plays)
        first = self.play_states.stop + before.order
        self.amplifier_states = {}
        for number, amplifier in enumerate(amplifiers):
            if amplifier.order:
                self.amplifier_states[number] = first
                first += amplifier.order

    def mode(self, touch: Touch) -> Mode:
        """The mode in which exactly this touches."""
        mode = self._modes.get(touch)
        if mode is None:
            played, rate = self._played(touch, self._mechanics.system(touch))
            system = played.then(self._after)
            guards = [*self._guards(touch, system), *self._play_guards(touch, played, rate, system.order)]
            self._modes[touch] = mode = Mode(touch, system, tuple(guards))
        return mode

    # --- plays -----------------------------------------------------------------------------------------

    def _played(self, touch: Touch, mechanics: StateSpace) -> tuple[StateSpace, Rows]:
        """The mechanics with the plays as further states and h as last output, and rows of their force's rate."""
        count, n = len(self._plays.radii), mechanics.order
        state, inputs = self._play_force(mechanics)
        # x' = c (A x + B u) + d u', and the voltage is the only input that changes.
        rate = (state @ mechanics.a, state @ mechanics.b + inputs[0] * np.array([0.0, 0.0, 1.0]))
        a, b = np.zeros((n + count, n + count)), np.zeros((n + count, INPUTS))
        a[:n, :n], b[:n] = mechanics.a, mechanics.b
        for k, drag in enumerate(touch.drag):
            if drag:
                a[n + k, :n], b[n + k] = rate
        c = np.zeros((len(mechanics.c) + 1, n + count))
        c[:-1, :n] = mechanics.c
        c[-1, n:] = self._plays.weights
        return StateSpace(a, b, c, np.vstack([mechanics.d, np.zeros(INPUTS)])), rate

    def _play_force(self, mechanics: StateSpace) -> Rows:
        own = np.array([1.0, 1.0 if self._plays.ring else 0.0])
        return own @ mechanics.c[:2], own @ mechanics.d[:2]

    def _play_guards(self, touch: Touch, played: StateSpace, rate: Rows, order: int) -> list[Guard]:
        n = self._mechanical
        state, inputs = self._play_force(played)
        force = _padded(state, order)
        guards = []
        for k, (drag, radius) in enumerate(zip(touch.drag, self._plays.radii, strict=True)):
            if drag:
                row = (drag * _padded(rate[0], order), drag * rate[1])
                guards.append(Guard(_single(*row), self._follow(touch, k, 0)))
                continue
            gap = force.copy()
            gap[n + k] -= 1.0
            # A little more than the radius, because rest begins at the radius itself where dragging ends.
            reach = np.array([0.0, radius * (1 + 1e-9), 0.0])
            for sign in (-1, 1):
                row = (-sign * gap, reach - sign * inputs)
                entry = self._seat(n + k, force, inputs, sign * radius)
                guards.append(Guard(_single(*row), self._follow(touch, k, sign), entry))
        return guards

    def _follow(self, touch: Touch, k: int, drag: int) -> Callable[[], Mode]:
        drags = (*touch.drag[:k], drag, *touch.drag[k + 1 :])
        return lambda: self.mode(replace(touch, drag=drags))

    @staticmethod
    def _seat(at: int, force: Floats, inputs: Floats, radius: float) -> Callable[[Floats, Floats], Floats]:
        """Function that sets a play one radius away from the force, where it begins to be dragged."""

        def entry(x: Floats, u: Floats) -> Floats:
            seated = x.copy()
            seated[at] = force @ x + inputs @ u - radius
            return seated

        return entry

    # --- guards ----------------------------------------------------------------------------------------

    def _guards(self, touch: Touch, system: StateSpace) -> list[Guard]:
        limits = self._limits
        compression, displacement, current = (
            (system.c[k], system.d[k]) for k in (self.compression, self.displacement, self.current)
        )
        voltage = (np.zeros(system.order), np.array([1.0, 0.0, 0.0]))
        guards = []
        for columns in self._mechanics.parting():
            tooth, ring = (touches != (k in columns) for k, touches in enumerate(touch.contact))
            row = self._mechanics.pressing(columns, compression)
            guards.append(self._sided(row, 0.0, touch.contact[columns[0]], replace(touch, contact=(tooth, ring))))
        for name, quantity, limit in (
            ("rail", voltage, limits.rail),
            ("current", self._unlimited_current(touch, system, current), limits.current),
            ("stop", displacement, limits.stop),
        ):
            if limit is None:
                continue
            side = getattr(touch, name)
            for sign in (side,) if side else (-1, 1):
                row = (sign * quantity[0], sign * quantity[1])
                change: dict[str, Any] = {name: 0 if side else sign}
                other = replace(touch, **change)
                if name == "current" and not side and self._armature.mass:
                    # This is as for plays: where limiting ends, the current is at the limit itself.
                    guard = self._sided(row, limit * (1 + 1e-9), False, other)
                    guards.append(replace(guard, entry=self._held(sign * limit)))
                else:
                    guards.append(self._sided(row, limit, bool(side), other))
        return guards

    def _held(self, current: float) -> Callable[[Floats, Floats], Floats]:
        """Function that sets the current to the limit itself; above it, it would be limited again when released."""
        at = self.stack_order

        def entry(x: Floats, u: Floats) -> Floats:
            seated = x.copy()
            seated[at] = current
            return seated

        return entry

    def _unlimited_current(self, touch: Touch, system: StateSpace, current: Rows) -> Rows:
        """Rows of the current; where it is held at its limit, of the one that the voltage would drive."""
        if not touch.current:
            return current
        arm = self._armature
        row = np.zeros(system.order)
        if arm.mass:
            row[self.stack_order + 2] = -arm.force_constant / arm.resistance
        return row, self._mechanics.voltage(touch) / arm.resistance

    def _sided(self, row: Rows, limit: float, beyond: bool, other: Touch) -> Guard:
        """Guard that a quantity stays above (`beyond`) or below a limit; else another mode follows."""
        sign = 1.0 if beyond else -1.0
        constant = np.array([0.0, limit, 0.0])
        return Guard(_single(sign * row[0], sign * (row[1] - constant)), lambda: self.mode(other))


def _fan_out(films: StateSpace, bridge_tau: float, weight: float) -> StateSpace:
    """System from the mechanics' outputs to the chain's outputs."""
    tooth, ring, compression, displacement, one, current, played = np.eye(7)
    spread = gain(
        np.array(
            [
                tooth,
                ring,
                played,
                one,
                tooth + ring + weight * one,
                tooth + ring + weight * one,
                compression,
                displacement,
                current,
            ]
        )
    )
    return spread.then(films.beside(first_order_low_pass(bridge_tau)).beside(gain(np.eye(4))))


def _single(state: Floats, inputs: Floats) -> Rows:
    return state[np.newaxis], inputs[np.newaxis]


def _padded(row: Floats, size: int) -> Floats:
    return np.append(row, np.zeros(size - len(row)))
