"""Characters take time on the serial line, and silence separates frames."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from palpate.instrument.bench.links import SHORTEST_SILENCE, SILENCE
from palpate.instrument.quantity import BitsPerSecond
from palpate.simulators.physics.effect import Bound, Case, Kind, LineEffect

CHARACTER = 11  # bits: start, eight, parity or a second stop, stop


class SerialTiming(LineEffect):
    """Modbus RTU: "MODBUS over serial line" 1.02, 2.5.1.1 [S]. The devices themselves answer at once [A]."""

    kind: ClassVar[Kind] = "timing"
    cancels_in_ratio: ClassVar[bool] = True

    baudrate: BitsPerSecond = Field(default=115_200.0, ge=1200, le=4e6)  # [A]

    def frame(self, size: int) -> float:
        character = CHARACTER / self.baudrate
        return size * character + max(SILENCE * character, SHORTEST_SILENCE)

    def known_bound(self, case: Case) -> Bound:
        """Timing alone does not change results."""
        return Bound(0.0, 0.0)
