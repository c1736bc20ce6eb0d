"""Twins of sensor nodes, which sample the rig's films at each SYNC: that of makers' nodes, by their maps, and ours."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.bench.links import Octets
from palpate.instrument.bench.role_maps import VOLTS, SensorNodeMap, raw_limits
from palpate.instrument.contracts.contract import Command, Field
from palpate.instrument.contracts.field import codec
from palpate.instrument.contracts.own import CHANNELS, RANGE_VOLTS, SENSOR_NODE
from palpate.instrument.sensor.design import Film
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.twin import CanopenTwin
from palpate.simulators.rig import FilmInputs, Rig
from palpate.simulators.wire.canopen_device import SimulatedNode, octets
from palpate.simulators.wire.device import SimulatedPlace

BEYOND = 0xFF00  # emergency code, manufacturer-specific


class SimulatedMappedNode(CanopenTwin):
    """The state of one node.

    Its converter has the steps of its counts, whatever converter the scene gives to our own nodes. What its input stage
    gives for a volt is not known from a map: it is what the bench file says, so that driver and twin agree. A value
    beyond the range of its counts stays at the end of the range.
    """

    def __init__(self, place: SimulatedPlace) -> None:
        table = place.kind.table(SensorNodeMap)
        self._channels = table.channels
        self._inputs = FilmInputs(place.rig, place.unit, place.number, len(table.channels))
        unit = place.kind.contract[table.channels[0]].unit
        self._volts_per_unit = VOLTS.get(unit, place.settings.volts_per_unit or 1.0)
        super().__init__(place)

    def reset(self) -> None:
        super().reset()
        self._counts = dict.fromkeys(self._channels, 0)
        self._zero = np.zeros(len(self._channels))  # [unit of the readings]
        self._last = self._zero
        self._beyond = False

    def read(self, field: Field) -> Any:
        """Raw value of an object, for the SDO server."""
        return self._counts[field.name] if field.name in self._counts else super().read(field)

    def carry_out(self, command: Command) -> None:
        """A tare makes the present readings zero."""
        if command.name == "tare":
            self._zero = self._zero + self._last
            self._last = np.zeros(len(self._channels))

    def frames_at(self, time_ns: Times, films: Callable[[], Floats], period_ns: int) -> list[tuple[int, Octets]]:
        """Its frames with the samples at these SYNCs; see `CanopenDevice.frames_at`."""
        pdos = self.at_sync()
        if not pdos:
            return []
        counts = self.sample(time_ns, self._inputs.film_channels @ films(), period_ns)
        found = []
        for pdo in pdos:
            columns = [self._column(name, counts, len(time_ns)) for name in pdo.fields]
            found.append((pdo.cob_id(self.id), octets([b"".join(row) for row in zip(*columns, strict=True)])))
        return found

    def sample(self, time_ns: Times, volts: Floats, period_ns: int) -> npt.NDArray[np.int64]:
        """Counts of each channel, shape (channels, n); see `FilmInputs.volts`."""
        volts = self._inputs.volts(time_ns, volts, period_ns)
        scales = [self._scale(self.contract[name]) for name in self._channels]
        step, offset, low, high = (np.array(each)[:, np.newaxis] for each in zip(*scales, strict=True))
        readings = volts / self._volts_per_unit - self._zero[:, np.newaxis]
        raw = np.rint((readings - offset) / step)
        beyond = ~((raw >= low) & (raw <= high))  # also where it is NaN
        raw = np.clip(np.where(np.isnan(raw), high, raw), low, high).astype(np.int64)
        self._counts = {name: int(raw[number, -1]) for number, name in enumerate(self._channels)}
        self._last = raw[:, -1] * step[:, 0] + offset[:, 0]
        self._tell(bool(beyond.any()))
        return raw

    def _tell(self, beyond: bool) -> None:
        """An emergency is sent when readings leave their range, once until they are back."""
        if beyond and not self._beyond:
            self.emergency(BEYOND)
        self._beyond = beyond

    def _scale(self, f: Field) -> tuple[float, float, int, int]:
        """Step and offset of a channel [unit of its readings], and its least and greatest count."""
        beside = {name: self.settings[name] for name in f.beside}
        step = self.contract.step(f.name, beside)
        return step, f.offset, *raw_limits(f, step)

    def _column(self, name: str, counts: npt.NDArray[np.int64], count: int) -> list[bytes]:
        """The bytes of a field in each of `count` frames."""
        f = self.contract[name]
        pack = codec(f.type, "<").pack
        if name in self._channels:
            return [pack(raw) for raw in counts[self._channels.index(name)].tolist()]
        return count * [pack(self.read(f))]


# --- ours ----------------------------------------------------------------------------------------------

CONTRACT = SENSOR_NODE
SATURATED = 0xFF01  # emergency code, manufacturer-specific
ROLLOVER = 1 << 8 * CONTRACT["sample_counter"].size
VOLTAGE_ERROR = 1 << CONTRACT["error_register"].bits["voltage"]
STAMPS = np.dtype([("counter", "<u4"), ("saturation", "u1")])  # data of the second PDO


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
    """The state of one of our sensor nodes, which has what no map tells: numbered samples, ranges and integrators."""

    contract = CONTRACT

    @classmethod
    def at(cls, place: SimulatedPlace) -> Self:
        return cls(place.clock, place.unit, place.serial, place.rig)

    def __init__(self, clock: VirtualClock, node_id: int, serial: int, rig: Rig) -> None:
        self._rig = rig
        self._inputs = FilmInputs(rig, node_id, node_id)
        super().__init__(clock, node_id, serial)

    def reset(self) -> None:
        """Return to the state after power-on."""
        super().reset()
        self._last = np.zeros(CHANNELS)
        self._clipped = False  # whether one of the samples that were taken last is saturated

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

    def frames_at(self, time_ns: Times, films: Callable[[], Floats], period_ns: int) -> list[tuple[int, Octets]]:
        """As for every node."""
        samples = self.sample(time_ns, self.film_channels @ films(), period_ns)
        self._clipped = bool(samples.saturation.any())
        stamps = np.empty(len(time_ns), STAMPS)
        stamps["counter"] = samples.counter + np.arange(len(time_ns))  # the counter rolls over as the field does
        stamps["saturation"] = samples.saturation
        data = samples.counts.view(np.uint8), stamps.view(np.uint8).reshape(len(stamps), -1)
        return [(pdo.base + self.id, each) for pdo, each in zip(CONTRACT.pdos, data, strict=True)]

    def sampled(self) -> None:
        """As for every node; an emergency is sent for the first saturated sample since the node was started."""
        if self._clipped and not self.settings["error_register"]:
            self.settings["error_register"] = VOLTAGE_ERROR
            self.emergency(SATURATED)

    def sample(self, time_ns: Times, volts: Floats, period_ns: int) -> SampleBlock:
        """Convert voltages to counts.

        Args:
            time_ns: times of the samples, one SYNC period apart, shape (n,) [ns].
            volts: voltage at each channel, shape (4, n) [V].
            period_ns: the SYNC period [ns].
        """
        ranges = [RANGE_VOLTS[int(self.settings[f"range_{c + 1}"])] for c in range(CHANNELS)]
        counts, bits = self._inputs.converted(time_ns, volts, period_ns, ranges)
        first_number = (int(self.settings["sample_counter"]) + 1) % ROLLOVER
        self.settings["sample_counter"] = float((first_number + len(time_ns) - 1) % ROLLOVER)
        self.settings["saturation"] = float(bits[-1])
        self._last = counts[-1]
        return SampleBlock(counts, bits, first_number)

    @functools.cached_property
    def film_channels(self) -> Floats:
        """Matrix of zeros and ones, shape (4, films), that puts each film of this node on its channel."""
        return self._inputs.film_channels

    def wired(self, film: Film) -> int | None:
        """This node's channel of a film, from 1; None: the film is wired to another node."""
        return self._inputs.wired(film)
