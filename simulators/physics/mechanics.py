"""Coil, armature and stack: systems from the coil voltage to the forces, for each combination of what touches."""

from __future__ import annotations

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.simulators.linear.lti import Rows, StateSpace
from palpate.simulators.physics.parts import Armature, Limits, Touch

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
