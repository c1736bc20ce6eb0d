"""What procedures ask of a bench: roles, not devices. `bench.role(Positioner)` gives the device that fills the role.

A role has what procedures use today, and no more. A device of a lab's own fills one by having these methods and
attributes, and by naming the role in its `DeviceKind`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

from palpate.drivers.devices.exciter import Exciter
from palpate.drivers.devices.sensor_node import Recording
from palpate.instrument.bench.kinds import Role

__all__ = [
    "Chamber", "Exciter", "LoadIndicator", "Positioner", "ProbeStage", "Reading", "Recording", "SampleChanger",
    "SensorNode", "role_of",
]  # fmt: skip


class Reading(Protocol):
    """What a load indicator shows: see `palpate.drivers.devices.strain_indicator.IndicatorReading`."""

    @property
    def reading_mV(self) -> float: ...
    @property
    def resolution_mV(self) -> float: ...
    @property
    def stable(self) -> bool: ...
    @property
    def sick(self) -> str:
        """Why no load can be read; empty: it can."""

    @property
    def valid(self) -> bool:
        """Whether it is stable, finite and not sick."""


class LoadIndicator(Protocol):
    """Reads the load cell.

    Attributes:
        name, serial: of the device; a calibration is kept by the serial number.
        resolution_mV: step of its display, as it was at the last reading.
        gage_factor: with which it makes mV of strain, so that a calibration holds for this one alone; 1 where it has
            no such setting.
    """

    name: str
    serial: str
    resolution_mV: float
    gage_factor: float

    def read(self) -> Reading: ...
    def track(self, time_constant: float) -> None:
        """From now on read the load, through a one-pole filter of `time_constant` s."""

    def peak_to_peak(self, window: float) -> None:
        """From now on read the peak-to-peak load over the last `window` s."""

    def clear_tare(self) -> None: ...


class Positioner(Protocol):
    """Moves the probe; positions in m, counted downwards from home."""

    def move(self, target: float, speed: float = ...) -> None:
        """Go to `target` at `speed` m/s and wait for it."""

    def home(self) -> None:
        """Go to 0 and wait for it."""

    def position(self) -> float: ...
    def travel(self) -> float:
        """The lowest position that it may go to."""


class SensorNode(Protocol):
    """Samples up to four films, on channels 1 to 4.

    Attributes:
        serial: of the device; a calibration of films is kept by that of the first node.
        ranges: its input ranges by name, with what they hold [V].
        emergencies: what it has told of its troubles so far.
    """

    serial: str
    ranges: Mapping[str, float]

    @property
    def emergencies(self) -> Sequence[bytes]: ...
    def set_sample_rate(self, rate: float) -> None:
        """Sample `rate` times a second."""

    def set_range(self, channel: int, range_: str) -> None: ...
    def resolution(self, channel: int) -> float:
        """Step of a channel's converter on the range that is set [V]."""

    def acquire_with(self, others: Sequence[Any], duration: float) -> list[Recording]:
        """Sample for `duration` s, at the same moments as other nodes of its kind; its own recording comes first."""


class Chamber(Protocol):
    """Warms the surroundings of the sensor."""

    def warm(self, kelvin: float) -> None:
        """Make them so many kelvin warmer than they were at the start; return when they are."""


class SampleChanger(Protocol):
    """Lays samples under the probe, by their names."""

    def check_holds(self, names: Iterable[str]) -> None:
        """Raises UnknownName: it does not hold one of these samples."""

    def mount(self, name: str) -> None: ...
    def leave(self) -> None:
        """From now on a person lays what he likes there."""

    def check(self) -> None:
        """See that what was laid lies there still. Raises SampleError."""


class ProbeStage(Protocol):
    """Sets a point probe above a place of the sensor."""

    def place_probe(self, x: float, y: float) -> None:
        """Above (x, y) m from the sensor's corner, the positioner being at home."""


_ROLES: dict[type, Role] = {
    Exciter: "exciter",
    LoadIndicator: "load_indicator",
    Positioner: "positioner",
    SensorNode: "sensor_node",
    SampleChanger: "sample_changer",
    Chamber: "chamber",
    ProbeStage: "probe_stage",
}


def role_of(asked: type) -> Role | None:
    """The name that bench files and kinds have for a role; None: `asked` is no role but a class of drivers."""
    return _ROLES.get(asked)
