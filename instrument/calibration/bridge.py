"""The Wheatstone bridge of a strain indicator (Appendix III of the thesis): its output, balance, and gages."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

from palpate.instrument.errors import RangeError


@dataclass(frozen=True, slots=True)
class Bridge:
    """R1 and R2 in series beside R4 and R3 in series; the voltmeter is between the middles (Figure A3.5).

    The indices in equations A3.2 and A3.3 are not readable; this is the usual order, in which both agree.

    Args:
        r1, r2, r3, r4: resistances, all in one unit.
        excitation: E, voltage of the battery [V].
    """

    r1: float
    r2: float
    r3: float
    r4: float
    excitation: float = 1.0

    def __post_init__(self) -> None:
        for name in ("r1", "r2", "r3", "r4", "excitation"):
            if not 0 < (value := getattr(self, name)) < math.inf:
                raise RangeError(f"bridge: {name} {value} must be above 0 and finite; correct it")

    @classmethod
    def of_gages(cls, factor: float, *strains: float) -> Self:
        """A bridge of gages on equal arms, each under its strain; ΔR/R = gage factor · strain (equation A3.1)."""
        return cls(*(1 + factor * strain for strain in strains))

    @property
    def output(self) -> float:
        """e = (R1/(R1 + R2) - R4/(R3 + R4)) E (equation A3.2) [V]."""
        off = self.r1 * self.r3 - self.r2 * self.r4  # 0 at balance (equation A3.3)
        return off / ((self.r1 + self.r2) * (self.r3 + self.r4)) * self.excitation

    @property
    def balancing_r1(self) -> float:
        """R1 that balances the other arms: R1 R3 = R2 R4 (equation A3.3)."""
        return self.r2 * self.r4 / self.r3
