"""The sensed object creeps: a Prony series in place of one modulus."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from instrument.quantity import Seconds
from simulators.chain import Stack
from simulators.effects.effect import Kind, StackEffect
from simulators.lti import StateSpace


class Viscoelastic(StackEffect):
    """E(s) = E (1 + sum of g / (1 - G) * tau s / (1 + tau s)), with E the sample's slow modulus and G the sum of g."""

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False

    # share of the fast modulus that relaxes, and how fast [A]
    g: tuple[float, ...] = Field(default=(0.3,), min_length=1, max_length=8)
    tau: tuple[Seconds, ...] = Field(default=(20e-3,), min_length=1, max_length=8)

    def stack(self, stack: Stack) -> StateSpace:
        g, tau = np.array(self.g), np.array(self.tau)
        fast = g / (1 - g.sum())
        # y = e(s) u by states x' = (u - x) / tau: e = 1 + sum of fast (1 - x / u).
        e = StateSpace(-np.diag(1 / tau), (1 / tau)[:, np.newaxis], -fast[np.newaxis], np.array([[1 + fast.sum()]]))
        # Ring branch: object and ring in series, e / (share + (1 - share) e) of its slow stiffness. With w the
        # compression of the ring, e acts on what is left: solved for w at every moment.
        share = stack.object_share
        a, b, c, d = e.a, e.b, e.c, float(e.d[0, 0])
        direct = share + (1 - share) * d
        loop = StateSpace(
            a - (1 - share) * b @ c / direct,
            b / direct,
            c * (1 - (1 - share) * d / direct),
            np.array([[d / direct]]),
        )
        return StateSpace(
            np.block([[a, np.zeros_like(a)], [np.zeros_like(a), loop.a]]),
            np.vstack([b, loop.b]),
            np.block([[stack.tooth * c, np.zeros_like(c)], [np.zeros_like(c), stack.ring * loop.c]]),
            np.array([[stack.tooth * d], [stack.ring * float(loop.d[0, 0])]]),
        )
