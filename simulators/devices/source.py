"""Simulated signal generator: a direct digital synthesiser with an integer phase."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

import numpy as np

from palpate.instrument.contracts import signal_generator
from palpate.instrument.contracts.signal_generator import LARGEST_PEAK
from palpate.simulators.clock import VirtualClock
from palpate.simulators.linear.periodic import HERTZ, Periodic
from palpate.simulators.wire.device import ILLEGAL_VALUE, Refused, SimulatedDevice, SimulatedPlace

HARMONICS = 25  # order of the highest harmonic of a square or triangle wave
FREQUENCY_STEPS = 1000  # steps per hertz: the resolution is 1 mHz


class SimulatedSignalGenerator(SimulatedDevice):
    """The signal generator. Calls `changed` when its output may have changed."""

    contract = signal_generator.CONTRACT

    @classmethod
    def at(cls, place: SimulatedPlace) -> Self:
        return cls(place.clock, place.serial, lambda: place.find("amplifier").input_changed())

    def __init__(self, clock: VirtualClock, serial: str, changed: Callable[[], None]) -> None:
        super().__init__(clock, serial)
        self._changed = changed
        self._waveform = self._formed(start_phase=0)

    def write(self, values: dict[str, float]) -> None:
        new = {**self.settings, **values}
        if new["amplitude"] + abs(new["offset"]) > LARGEST_PEAK:
            self.settings["error"] = self.contract["error"].choices["amplitude_plus_offset"]
            raise Refused(ILLEGAL_VALUE)
        now = self.clock.now_ns()
        phase = 0 if values.get("phase_reset") else int(self._waveform.phase(np.array([now]))[0])
        self.settings = {**new, "phase_reset": 0.0, "error": 0.0, "writes": new["writes"] + 1}
        self._waveform = self._formed(phase)
        self._changed()

    def reset(self) -> None:
        super().reset()
        self.settings["writes"] = 0.0

    def out_of_range(self) -> None:
        self.settings["error"] = self.contract["error"].choices["range"]

    def read(self, name: str) -> float:
        if name == "status":
            return self.settings["output"]  # bit 0
        return super().read(name)

    def voltage(self) -> Periodic:
        """Output voltage."""
        return self._waveform if self.settings["output"] else self._waveform.scaled(0.0)

    def _formed(self, start_phase: int) -> Periodic:
        """The waveform of the present settings, from now on."""
        s = self.settings
        k = np.arange(1, HARMONICS + 1, 2)
        match self.contract.choice("waveform", s["waveform"]):
            case "square":
                sines = 4 / (np.pi * k)
            case "triangle":
                sines = 8 / (np.pi * k) ** 2 * np.where(k % 4 == 1, 1, -1)
            case _:
                k, sines = np.array([1]), np.array([1.0])
        return Periodic(
            s["offset"],
            round(s["frequency"] * FREQUENCY_STEPS) * (HERTZ // FREQUENCY_STEPS),
            self.clock.now_ns(),
            start_phase,
            k,
            (-1j * s["amplitude"] * sines).astype(complex),
        )
