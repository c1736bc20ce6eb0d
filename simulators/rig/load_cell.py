"""The load cell of the rig with its bridge, as every simulated load indicator reads it."""

from __future__ import annotations

import numpy as np

from palpate.simulators.linear.lti import Floats
from palpate.simulators.randomness import Stream
from palpate.simulators.rig.rig import Rig

IDEAL_SENSITIVITY = 10.306e-3  # V/N in a scene without the effect `load_cell`: line through Table 5.1 [T]
GAGE_FACTOR = 8.98  # gage factor for which the sensitivities are given [T]
IDEAL_DECIMALS = 4  # decimals of a display in a scene without the effect `load_cell`


class RigLoadCell:
    """The load cell under the probe. Call its methods under the clock's lock."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._cell = rig.effects.cell
        self._stream = Stream(rig.scene.seed, self._cell.name if self._cell else "")

    @property
    def decimals(self) -> int:
        """Decimals of a display in mV."""
        return self._cell.digits if self._cell else IDEAL_DECIMALS

    def signal(self, force: float, gage_factor: float = GAGE_FACTOR) -> float:
        """What the bridge gives for a force on the cell [N], at a gage factor, without offset and noise [mV]."""
        sensitivity = self._cell.in_position(self._rig.cell_position) if self._cell else IDEAL_SENSITIVITY
        return 1e3 * force * sensitivity * GAGE_FACTOR / gage_factor

    def shown(self, signal: float, update: int) -> float:
        """A signal [mV] with the offset, noise and steps of the display, at its update of that number."""
        return self._cell.display(signal, self._stream, update) if self._cell else signal

    def given(self, signal: float, update: int) -> float:
        """A signal [mV] with offset and noise, as a display gets it that has steps of its own."""
        return signal + self._cell.added_mV(self._stream, update) if self._cell else signal

    def crept(self, force: float, now_ns: int) -> float:
        """Force that the cell feels [N], where `force` stands on it."""
        return self._cell.crept(force, self._rig.placed, now_ns) if self._cell else force

    def forces(self, until_ns: int, count: int, step_ns: int) -> Floats:
        """Forces on the cell at `count` times, a step apart, up to a time of the last 12 s (count,) [N]."""
        return self._rig.cell_force(until_ns - np.arange(count - 1, -1, -1) * step_ns, step_ns)
