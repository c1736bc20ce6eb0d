"""The twin of a sensor node of any maker: it samples the rig's films at each SYNC, in its own counts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.instrument.bench.role_maps.sensor_node import VOLTS, SensorNodeMap, raw_limits
from palpate.instrument.contracts.contract import Command, Field
from palpate.instrument.contracts.field import codec
from palpate.simulators.linear.lti import Floats
from palpate.simulators.mapped.twin import CanopenTwin
from palpate.simulators.rig.rig import FilmInputs
from palpate.simulators.wire.canopen_device import Times
from palpate.simulators.wire.device import SimulatedPlace

SATURATED = 0xFF00  # emergency code, manufacturer-specific


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

    def frames_at(self, time_ns: Times, films: Callable[[], Floats], period_ns: int) -> list[tuple[int, list[bytes]]]:
        """Its frames with the samples at these SYNCs; see `CanopenDevice.frames_at`."""
        pdos = self.at_sync()
        if not pdos:
            return []
        counts = self.sample(time_ns, self._inputs.film_channels @ films(), period_ns)
        found = []
        for pdo in pdos:
            columns = [self._column(name, counts, len(time_ns)) for name in pdo.fields]
            found.append((pdo.cob_id(self.id), [b"".join(row) for row in zip(*columns, strict=True)]))
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
            self.emergency(SATURATED)
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
