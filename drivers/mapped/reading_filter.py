"""The filter of a load indicator's readings: whether it is as it was, and which frequencies get through."""

from __future__ import annotations

from palpate.drivers.devices.device import Device
from palpate.drivers.mapped.following import LARGEST_LOSS, Following
from palpate.instrument.bench.role_maps.load_indicator import LoadIndicatorMap, LoadIndicatorSettings, LowPass
from palpate.instrument.errors import RangeError


class ReadingFilter:
    """The low-pass through which the readings of a load indicator go.

    Attributes:
        level: raw value of the field that sets it; None: no field does, or neither section nor device told it yet.
    """

    def __init__(self, device: Device, role: LoadIndicatorMap, settings: LoadIndicatorSettings) -> None:
        self._device, self._role, self._settings = device, role, settings
        self._table = role.filter
        self.level: float | None = settings.filter

    def set_up(self) -> None:
        """Write the level of the section, and read the one that the device has. Raises LinkError, DeviceError."""
        if self._table is not None:
            if self._settings.filter is not None:
                self._device.give(**{self._table.field: self._settings.filter})
            self.level = self._device.get(self._table.field)

    @property
    def told_by_section(self) -> bool:
        """Whether the section tells the filter, so that the device need not be asked."""
        return self._table is None or self._settings.filter is not None

    @property
    def following(self) -> Following:
        """What the readings can follow. Raises RangeError: nothing tells the filter."""
        name, rate = self._device.name, self._settings.rate or self._role.rate
        if self._table is not None:
            low_pass = self._table.levels.get(f"{self.level:g}")
            if low_pass is None:
                raise RangeError(
                    f"{name}: {self._table.field} reads {self.level:g}, of which the map tells no cut-off "
                    f"frequency; write filter = one of {', '.join(self._table.levels)} in its section"
                )
        elif self._settings.bandwidth is None:
            raise RangeError(
                f"{name}: no field tells the filter of its readings, so it is not known which forces they "
                'follow; write bandwidth = "NUMBER Hz" in its section, as set at the device'
            )
        else:
            low_pass = LowPass(corner=self._settings.bandwidth)
        return Following(low_pass, rate, polled=not self._role.extremes)

    def check_kind(self) -> None:
        """Raises RangeError: another kind of filter is set than that of which the map tells the frequencies."""
        contract = self._device.contract
        for name, needed in self._table.needs.items() if self._table else ():
            if (found := self._device.get(name)) != needed:
                raise RangeError(
                    f"{self._device.name}: {name} reads {contract.choice(name, found)}; the map tells cut-off "
                    f"frequencies for {contract.choice(name, needed)} alone; set it so at the device"
                )

    def check_frequency(self, frequency: float) -> None:
        """Raises RangeError: a peak-to-peak reading would lose too much at this frequency [Hz]."""
        following = self.following
        if (loss := following.loss(frequency)) <= LARGEST_LOSS:
            return
        levels = self._table.levels if self._table else {}
        able = [
            level
            for level, low_pass in levels.items()
            if Following(low_pass, following.rate, following.polled).loss(frequency) <= LARGEST_LOSS
        ]
        now = f"{self._table.field} = {self.level:g}: " if self._table else ""
        faster = "" if self._table else "set the device faster and write its bandwidth and rate in its section, or "
        remedy = f"write filter = {able[0]} in its section, or " if able else faster
        raise RangeError(
            f"{self._device.name}: its readings ({now}{following.filter.corner:g} Hz, {following.rate:g} a second) "
            f"lose up to {100 * loss:.2g} % of a force at {frequency:g} Hz, {100 * LARGEST_LOSS:g} % are allowed; "
            f"{remedy}drive at up to {following.highest():g} Hz"
        )

    def changed(self) -> str:
        """Which part of it is not as it was, so that the load would be taken for less than it is; empty: none."""
        return ", ".join(f"{n} has changed" for n, value in self._fields().items() if self._device.get(n) != value)

    def changes(self) -> list[str]:
        """What somebody has changed that a recovery does not write again, as texts for people."""
        found = []
        for name, value in self._fields().items():
            restored = self._table is not None and name == self._table.field and self._settings.filter is not None
            if not restored and (now := self._device.get(name)) != value:
                found.append(f"{self._device.name}: {name} is {now:g}, was {value:g}")
        return found

    def _fields(self) -> dict[str, float | None]:
        """What the fields of the filter must read."""
        return {self._table.field: self.level, **self._table.needs} if self._table else {}
