"""What of a map serves a load indicator, and the settings of such a device in a bench file."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Annotated, ClassVar

from pydantic import Field

from palpate.instrument.bench.role_maps.role_map import RoleMap
from palpate.instrument.config import Config, Positive
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.quantity import Hertz

NOT = "not "  # before a bit: it says the opposite


def says(bits: Collection[str], which: str) -> bool:
    """Whether bits that are set say what a map asks for: "BIT" or "not BIT"."""
    return (which.removeprefix(NOT) in bits) != which.startswith(NOT)


class LowPass(Config):
    """A low-pass filter: its cut-off frequency (3 dB) [Hz], and its order."""

    corner: Annotated[float, Field(gt=0, strict=True)]
    order: Annotated[int, Field(ge=1, le=8, strict=True)] = 1

    def passes(self, frequency: float) -> float:
        """The share of a sine of a frequency [Hz] that passes, if the filter is a Butterworth filter."""
        return 1 / math.sqrt(1 + (frequency / self.corner) ** (2 * self.order))


class FilterTable(Config):
    """The field that sets the filter of the readings, and the low-pass for each of its raw values.

    They hold while the fields in `needs` read these raw values.
    """

    field: str
    needs: dict[str, int] = Field(default_factory=dict)
    levels: Annotated[dict[Annotated[str, Field(pattern="^[0-9]+$")], LowPass], Field(min_length=1)]


class LoadIndicatorSettings(Config):
    """Settings of a load indicator of a maker.

    Attributes:
        span: what the load cell gives for one unit of the display, by its data sheet [mV].
        gage_factor: gage factor for which `span` holds; a calibration holds only for this one.
        filter: raw value to which the filter is set; None: it stays as it is.
        bandwidth: cut-off frequency of the readings, as set at the device, where no field tells it [Hz].
        rate: readings in a second, as set at the device, if that differs from the map's [1/s].
        resolution: step of the display, in its unit, where no field tells it.
    """

    span: Annotated[
        float,
        Field(
            ge=1e-6,
            le=1e6,
            strict=True,
            description="the mV of the load cell for one unit of the display, as 10.306",
        ),
    ]
    gage_factor: Annotated[float, Field(ge=0.5, le=20, strict=True)] = 8.98  # [T]
    filter: Annotated[int, Field(ge=0, strict=True)] | None = None
    bandwidth: Annotated[Hertz, Field(ge=0.01, le=1e5)] | None = None
    rate: Annotated[Hertz, Field(ge=0.01, le=1e5)] | None = None
    resolution: Annotated[float, Field(ge=1e-6, le=1e6, strict=True)] | None = None


class LoadIndicatorMap(RoleMap):
    """The table `[role.load_indicator]`.

    Attributes:
        reading: field of the load, net of tare.
        gross: field of the load with the tare in it; "": there is none.
        status: field whose bits tell of the reading; "": there is none.
        stable: its bit that says that the reading is stable, or "not BIT" for one that says that it moves; "":
            stability is told by repeated readings.
        faults: its bits that say that there is no load to read, each with what it means; "not BIT" for one that says
            that there is a load.
        peak_to_peak: field of the greatest less the least reading since these were cleared; "": there is none.
        greatest, least: fields of the greatest and the least reading since they were cleared; "": there are none.
        clear: command that clears the extremes; needed where a field of extremes is named.
        tare, clear_tare: commands that take the present load as the tare, and take the tare off; "": there are none.
        step: field of the display's step, as a number in the unit of `reading`; "": see `steps`.
        steps: for each raw value of `step`, the display's step, if it is a code.
        filter: the field that sets the filter; None: no field does.
        rate: readings in a second [1/s].
    """

    generic_driver: ClassVar[str] = "palpate.drivers.devices.load_indicator:MappedLoadIndicator"
    generic_simulator: ClassVar[str | None] = "palpate.simulators.devices.load_indicator:SimulatedMappedLoadIndicator"
    settings: ClassVar[type[Config] | None] = LoadIndicatorSettings

    reading: str
    gross: str = ""
    status: str = ""
    stable: str = ""
    faults: dict[str, str] = Field(default_factory=dict)
    peak_to_peak: str = ""
    greatest: str = ""
    least: str = ""
    clear: str = ""
    tare: str = ""
    clear_tare: str = ""
    step: str = ""
    steps: dict[str, Positive] = Field(default_factory=dict)
    filter: FilterTable | None = None
    rate: Annotated[float, Field(gt=0, strict=True)]

    @property
    def extremes(self) -> tuple[str, ...]:
        """The fields that the device's own peak-to-peak reading is made of; empty: it has none."""
        if self.peak_to_peak:
            return (self.peak_to_peak,)
        return (self.greatest, self.least) if self.greatest and self.least else ()

    def wrong(self, contract: Contract) -> list[str]:
        """What the contract lacks that this table names, each with key, value and what is valid; empty: it fits."""
        readable = [f.name for f in contract.fields if f.access != "wo" and f.type != "text"]
        fields = ("reading", "gross", "status", "peak_to_peak", "greatest", "least", "step")
        given = {key: getattr(self, key) for key in fields}
        if self.filter is not None:
            given |= {"filter.field": self.filter.field} | {f"filter.needs.{name}": name for name in self.filter.needs}
        found = [
            f"{key} = {name!r} is no field that can be read; valid: {', '.join(readable)}"
            for key, name in given.items()
            if name and name not in readable
        ]
        commands = [command.name for command in contract.commands]
        found += [
            f"{key} = {name!r} is no command; valid: {', '.join(commands) or 'none'}"
            for key, name in (("clear", self.clear), ("tare", self.tare), ("clear_tare", self.clear_tare))
            if name and name not in commands
        ]
        if found:
            return found
        bits = contract[self.status].bits if self.status else {}
        found += [
            f"{bit!r} is no bit of status = {self.status!r}; valid: {', '.join(bits) or 'none'}"
            for bit in (*filter(None, (self.stable,)), *self.faults)
            if bit.removeprefix(NOT) not in bits
        ]
        units = {contract[name].unit for name in (self.reading, *self.extremes)}
        if len(units) > 1:
            found.append(f"the readings are in {' and '.join(sorted(units))}; they must be in one unit")
        if bool(self.greatest) != bool(self.least):
            found.append("greatest and least: give both, or none")
        if self.extremes and not self.clear:
            found.append(f"clear: {', '.join(self.extremes)} must be cleared by a command; name it, or leave them out")
        if self.filter is not None and contract[self.filter.field].access != "rw":
            found.append(f"filter.field = {self.filter.field!r} cannot be written; its access must be 'rw'")
        return found
