"""The sensed object creeps: a Prony series in place of one modulus."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from palpate.instrument.quantity import Seconds
from palpate.simulators.linear.lti import StateSpace
from palpate.simulators.physics.chain import SpringStack
from palpate.simulators.physics.effect import Kind, StackEffect

# These are the shares of the fast modulus that relax, and their time constants [s].
PRONY: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "rubber": ((0.3,), (20e-3,)),  # [A]
    # two terms of the size that is reported for brain; no source was checked [A]
    "soft_tissue": ((0.450, 0.365), (0.5, 50.0)),
}


class Viscoelastic(StackEffect):
    """E(s) = E (1 + sum of g / (1 - G) * tau s / (1 + tau s)), with E the sample's slow modulus and G the sum of g.

    At 10 Hz rubber is 1.28 times as stiff as at rest; with the slow modulus alone the ratio of the thesis' samples
    would be 11 to 15 % too small [M]. The difference is greatest for a sample that is hard beside its ring, where the
    object alone decides.
    """

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False

    material: Literal["rubber", "soft_tissue"] = "rubber"
    # terms of a Prony series that replace the material's own
    g: tuple[Annotated[float, Field(ge=0, lt=1, strict=True)], ...] | None = Field(default=None, max_length=8)
    tau: tuple[Annotated[Seconds, Field(ge=1e-6, le=1e6)], ...] | None = Field(default=None, max_length=8)

    @model_validator(mode="after")
    def _fitting(self) -> Viscoelastic:
        if (self.g is None) != (self.tau is None):
            raise ValueError("g and tau belong together; give both, or neither and a material")
        g, tau = self.prony
        if len(g) != len(tau):
            raise ValueError(f"g has {len(g)} terms and tau {len(tau)}; give as many of each")
        if not sum(g) < 1:
            raise ValueError(f"g sums to {sum(g):g}, not below 1: nothing would be left at rest; give smaller ones")
        return self

    @property
    def prony(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Shares g and time constants [s]."""
        if self.g is None or self.tau is None:
            return PRONY[self.material]
        return self.g, self.tau

    def stack(self, stack: SpringStack) -> StateSpace:
        terms = [(g, tau) for g, tau in zip(*self.prony, strict=True) if g > 0]
        if not terms:
            return stack.elastic()
        g, tau = np.array(terms).T
        fast = g / (1 - g.sum())
        # y = e(s) u with states x' = (u - x) / tau: e = 1 + sum of fast (1 - x / u).
        e = StateSpace(-np.diag(1 / tau), (1 / tau)[:, np.newaxis], -fast[np.newaxis], np.array([[1 + fast.sum()]]))
        # Ring branch: object and ring in series, e / (share + (1 - share) e) of the slow stiffness. With w the
        # compression of
        # the ring, e acts on the rest of the compression; this is solved for w at every moment.
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
            np.block([[b, np.zeros_like(b)], [np.zeros_like(b), loop.b]]),
            np.block([[stack.tooth * c, np.zeros_like(c)], [np.zeros_like(c), stack.ring * loop.c]]),
            np.diag([stack.tooth * d, stack.ring * float(loop.d[0, 0])]),
        )
