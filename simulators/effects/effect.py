"""What every effect is: frozen parameters with units, default and source, and its kind."""

from __future__ import annotations

from typing import ClassVar, Literal

from instrument.config import Config

Kind = Literal["lti", "static_nl", "hysteresis", "additive", "ltv"]


class Effect(Config):
    """One imperfection. A subclass stands alone in its file.

    Its parameters are fields whose defaults carry a mark: [T] thesis, [S] published source, [M] measured,
    [A] assumption. `kind` says how the scene treats it: `lti` gives a state space or gains, `static_nl` a
    memoryless map, `additive` a noise of its own random stream.
    """

    kind: ClassVar[Kind]
    cancels_in_ratio: ClassVar[bool]
