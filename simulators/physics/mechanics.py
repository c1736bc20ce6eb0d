"""Coil, armature and stack: from the coil voltage to the forces, whatever touches."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simulators.linear.lti import Floats, StateSpace

if TYPE_CHECKING:
    from simulators.physics.chain import Armature, Limits, Touch

INPUTS = 3  # coil voltage [V], 1, rate of the coil voltage [V/s]


class Mechanics:
    """From the inputs to forces on tooth and ring, compression, displacement, 1 and the current.

    Args:
        armature, limits: of the shaker.
        stack: from the compression of the stack [m] to the forces on tooth and ring [N].
        advance: of the probe past the point where it meets the sample [m].
    """

    def __init__(self, armature: Armature, limits: Limits, stack: StateSpace, advance: float) -> None:
        self._armature, self._limits, self._stack, self._advance = armature, limits, stack, advance

    def system(self, touch: Touch) -> StateSpace:
        """While just this touches."""
        return self._dynamic(touch) if self._armature.mass else self._quasi_static(touch)

    def _springs(self, touch: Touch) -> tuple[float, float]:
        """Stiffness of suspension and stop [N/m], and the force of the stop at rest [N]."""
        stiffness, push = self._armature.suspension, 0.0
        if touch.stop and self._limits.stop is not None:
            stiffness += self._limits.stop_stiffness
            push = touch.stop * self._limits.stop_stiffness * self._limits.stop
        return stiffness, push

    def voltage(self, touch: Touch) -> Floats:
        """Rows over the inputs of the voltage that the amplifier gives."""
        if touch.rail and self._limits.rail is not None:
            return np.array([0.0, touch.rail * self._limits.rail, 0.0])
        return np.array([1.0, 0.0, 0.0])

    def _quasi_static(self, touch: Touch) -> StateSpace:
        """All in balance."""
        stack = self._stack
        voltage = self.voltage(touch)
        current = voltage / self._armature.resistance
        if touch.current and self._limits.current is not None:
            current = np.array([0.0, touch.current * self._limits.current, 0.0])
        stiffness, push = self._springs(touch)
        pushed = self._armature.force_constant * current + np.array([0.0, push, 0.0])
        one = np.array([0.0, 1.0, 0.0])
        # The stack's force is sums @ (C z + D compression), and compression is displacement + advance.
        sums = np.ones(2) if touch.contact else np.zeros(2)
        direct = float(sums @ stack.d[:, 0])
        by_input = (pushed - direct * self._advance * one) / (stiffness + direct)
        by_state = -(sums @ stack.c) / (stiffness + direct)
        squeezed = 1.0 if touch.contact else 0.0
        compression = by_input + self._advance * one
        return StateSpace(
            stack.a + np.outer(stack.b[:, 0], squeezed * by_state),
            np.outer(stack.b[:, 0], squeezed * compression),
            np.vstack(
                [
                    squeezed * (stack.c + np.outer(stack.d[:, 0], by_state)),
                    by_state,
                    by_state,
                    0 * by_state,
                    0 * by_state,
                ]
            ),
            np.vstack([squeezed * np.outer(stack.d[:, 0], compression), compression, by_input, one, current]),
        )

    def _dynamic(self, touch: Touch) -> StateSpace:
        """With inertia: L i' = u - R i - Bl v, m v' = Bl i - c v - k x - F.

        States: those of the stack, then i, x, v.
        """
        stack, arm = self._stack, self._armature
        n = stack.order
        stiffness, push = self._springs(touch)
        squeezed = 1.0 if touch.contact else 0.0
        a, b = np.zeros((n + 3, n + 3)), np.zeros((n + 3, INPUTS))
        i, x, v = n, n + 1, n + 2
        a[:n, :n] = stack.a
        a[:n, x] = squeezed * stack.b[:, 0]
        b[:n, 1] = squeezed * stack.b[:, 0] * self._advance
        if not (touch.current and self._limits.current is not None):
            a[i, i], a[i, v] = -arm.resistance / arm.inductance, -arm.force_constant / arm.inductance
            b[i] = self.voltage(touch) / arm.inductance
        a[x, v] = 1.0
        direct = squeezed * float(stack.d[:, 0].sum())
        a[v, :n] = -squeezed * stack.c.sum(axis=0) / arm.mass
        a[v, i], a[v, v] = arm.force_constant / arm.mass, -arm.damping / arm.mass
        a[v, x] = -(stiffness + direct) / arm.mass
        b[v, 1] = (push - direct * self._advance) / arm.mass
        c, d = np.zeros((6, n + 3)), np.zeros((6, INPUTS))
        c[:2, :n] = squeezed * stack.c
        c[:2, x] = squeezed * stack.d[:, 0]
        d[:2, 1] = squeezed * stack.d[:, 0] * self._advance
        c[2, x], d[2, 1] = 1.0, self._advance
        c[3, x] = 1.0
        d[4, 1] = 1.0
        c[5, i] = 1.0
        return StateSpace(a, b, c, d)
