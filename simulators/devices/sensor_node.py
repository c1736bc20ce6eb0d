"""Simulated sensor nodes: they sample the films' voltages at each SYNC, and answer for their CANopen objects."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.instrument.contracts import sensor_node
from palpate.instrument.contracts.contract import Field
from palpate.instrument.contracts.sensor_node import CHANNELS, FULL_SCALE_COUNTS, RANGE_VOLTS
from palpate.instrument.sensor.design import Film
from palpate.simulators.clock import VirtualClock
from palpate.simulators.physics.converter import convert
from palpate.simulators.rig.rig import FilmInputs, Rig
from palpate.simulators.wire.canopen_device import SimulatedNode

CONTRACT = sensor_node.CONTRACT
SATURATED = 0xFF01  # emergency code, manufacturer-specific
ROLLOVER = 1 << 8 * CONTRACT["sample_counter"].size
VOLTAGE_ERROR = 1 << CONTRACT["error_register"].bits["voltage"]


@dataclass(frozen=True)
class SampleBlock:
    """A block of samples of one node.

    Attributes:
        counts: converter counts, shape (n, 4), int16.
        saturation: a bit for each saturated channel, shape (n,).
        counter: counter of the first sample, modulo 2^32.
    """

    counts: npt.NDArray[np.int16]
    saturation: npt.NDArray[np.uint8]
    counter: int


class SimulatedSensorNode(SimulatedNode):
    """The state of one sensor node."""

    contract = CONTRACT

    def __init__(self, clock: VirtualClock, node_id: int, serial: int, rig: Rig) -> None:
        self._rig = rig
        self._converter = rig.effects.converter
        self._inputs = FilmInputs(rig, node_id, node_id)
        super().__init__(clock, node_id, serial)

    def reset(self) -> None:
        """Return to the state after power-on."""
        super().reset()
        self._last = np.zeros(CHANNELS)

    def start(self) -> None:
        """Enter the NMT state operational: the sample counter starts again, so that the next sample is number 1."""
        self.settings["sample_counter"] = 0.0
        self.settings["saturation"] = 0.0
        self.settings["error_register"] = 0.0

    def read(self, field: Field) -> Any:
        """Raw value of an object, for the SDO server."""
        if field.name.startswith("sample_") and field.name[-1].isdigit():
            return int(self._last[int(field.name[-1]) - 1])
        return super().read(field)

    def write(self, field: Field, value: float) -> None:
        """Store a checked setting; a reset command discharges the film's charge amplifier instead."""
        if field.name.startswith("reset_"):
            for film in self._rig.scene.design.films:
                if self.wired(film) == int(field.name.removeprefix("reset_")):
                    self._rig.reset_film(film.channel)
        else:
            super().write(field, value)

    def sample(self, time_ns: npt.NDArray[np.int64], volts: npt.NDArray[np.float64], period_ns: int) -> SampleBlock:
        """Convert voltages to counts.

        Args:
            time_ns: times of the samples, one SYNC period apart, shape (n,) [ns].
            volts: voltage at each channel, shape (4, n) [V].
            period_ns: the SYNC period [ns].
        """
        volts = self._inputs.volts(time_ns, volts, period_ns)
        ranges = np.array([RANGE_VOLTS[int(self.settings[f"range_{c + 1}"])] for c in range(CHANNELS)])
        volts /= ranges[:, np.newaxis]
        fraction, saturated = (self._converter.convert if self._converter else convert)(volts)
        fraction *= FULL_SCALE_COUNTS
        bits = np.zeros(len(time_ns), np.uint8)
        if saturated.any():
            bits = np.packbits(saturated, axis=0, bitorder="little")[0]
            fraction[np.isnan(fraction)] = 0.0  # the saturation bit marks it; an integer cannot hold NaN
        counts = np.empty((len(time_ns), CHANNELS), "<i2")
        for channel in range(CHANNELS):
            counts[:, channel] = fraction[channel]  # twice as fast as one assignment for all channels
        first_number = (int(self.settings["sample_counter"]) + 1) % ROLLOVER
        self.settings["sample_counter"] = float((first_number + len(time_ns) - 1) % ROLLOVER)
        self.settings["saturation"] = float(bits[-1])
        self._last = counts[-1]
        return SampleBlock(counts, bits, first_number)

    @functools.cached_property
    def film_channels(self) -> npt.NDArray[np.float64]:
        """Matrix of zeros and ones, shape (4, films), that puts each film of this node on its channel."""
        return self._inputs.film_channels

    def wired(self, film: Film) -> int | None:
        """This node's channel of a film, from 1; None: the film is wired to another node."""
        return self._inputs.wired(film)
