"""What procedures use devices as, whatever kind they are: `bench.role(Positioner)` gives the device that is one.

Each role asks for what procedures use today, and no more.
"""

from __future__ import annotations

from typing import Any, Protocol

from palpate.drivers.devices.exciter import Exciter
from palpate.instrument.bench.kinds import Role

__all__ = ["Chamber", "Exciter", "LoadIndicator", "Positioner", "ProbeStage", "SampleChanger", "SensorNode", "role_of"]


class LoadIndicator(Protocol):
    """Reads the load cell. `resolution_mV`: step of its display, as it was at the last reading."""

    resolution_mV: float

    def read(self) -> Any: ...
    def track(self, time_constant: float) -> None: ...
    def peak_to_peak(self, window: float) -> None: ...
    def clear_tare(self) -> None: ...


class Positioner(Protocol):
    """Moves the probe; positions in m, counted downwards from home."""

    def move(self, target: float, speed: float = ...) -> None: ...
    def home(self) -> None: ...
    def position(self) -> float: ...
    def travel(self) -> float: ...


class SensorNode(Protocol):
    """Samples films."""

    def set_sample_rate(self, rate: float) -> None: ...
    def set_range(self, channel: int, range_: str) -> None: ...
    def acquire(self, duration: float) -> Any: ...


class Chamber(Protocol):
    """Warms the surroundings of the sensor."""

    def warm(self, kelvin: float) -> None:
        """Make them so many kelvin warmer than they were at the start; return when they are."""


class SampleChanger(Protocol):
    """Lays samples under the probe, by their names."""

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
