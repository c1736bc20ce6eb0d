"""The roles in which procedures use devices. `bench.role(Positioner)` gives the device that fills this role.

A role has only the methods and attributes that procedures use. A lab's own device fills a role if it has them, and if
its `DeviceKind` names the role.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from palpate.drivers.devices.exciter import Exciter
from palpate.instrument.bench.kinds import Role

if TYPE_CHECKING:
    from palpate.drivers.devices.sensor_node import Recording

__all__ = [
    "Bias", "Chamber", "Exciter", "LoadIndicator", "Positioner", "ProbeStage", "Reading", "SampleChanger",
    "SamplesInPieces", "SensorNode", "is_difference", "made_u", "role_of", "why_invalid",
]  # fmt: skip


class Reading(Protocol):
    """A reading of a load indicator: see `palpate.drivers.devices.load_indicator.IndicatorReading`."""

    @property
    def reading_mV(self) -> float: ...
    @property
    def resolution_mV(self) -> float: ...
    @property
    def stable(self) -> bool: ...
    @property
    def sick(self) -> str:
        """Why no load can be read; empty: a load can be read."""

    @property
    def valid(self) -> bool:
        """Whether it is stable, finite and not sick."""


def is_difference(reading: Reading) -> bool:
    """Whether a reading is the difference of two loads, so that it holds no zero, as its `difference` says."""
    return bool(getattr(reading, "difference", False))  # packages need not have it


def made_u(reading: Reading) -> float:
    """Standard uncertainty of a reading from how it was made [mV], beside that of the display, as its `u_mV` says."""
    return float(getattr(reading, "u_mV", 0.0))  # packages need not have it


def why_invalid(reading: Reading) -> str:
    """Why a reading is not valid, as its `sick` or `unsteady` says; empty: it is valid."""
    if reading.valid:
        return ""
    unsteady = (
        "" if reading.stable else str(getattr(reading, "unsteady", "")) or "not stable"
    )  # packages need not have it
    return reading.sick or unsteady or f"it reads {reading.reading_mV:g} mV"


class LoadIndicator(Protocol):
    """Reads the load cell.

    Attributes:
        name: its name.
        serial: its serial number, by which calibrations are stored.
        resolution_mV: step of its display at the last reading.
        gage_factor: gage factor by which it converts strain into mV, so that a calibration holds only for this one; 1
            if it has no such setting.
    """

    name: str
    serial: str
    resolution_mV: float
    gage_factor: float

    def read(self) -> Reading: ...
    def track(self, time_constant: float) -> None:
        """From now on read the load through a one-pole filter with this time constant [s]."""

    def peak_to_peak(self, window: float) -> None:
        """From now on read the peak-to-peak load over the last `window` [s]."""

    def clear_tare(self) -> None: ...


class Positioner(Protocol):
    """Moves the probe; positions are counted downwards from home [m]."""

    def move(self, target: float, speed: float = ...) -> None:
        """Go to `target` [m] at `speed` [m/s], and wait until it is there."""

    def home(self) -> None:
        """Go to 0, and wait until it is there."""

    def position(self) -> float: ...
    def travel(self) -> float:
        """The lowest position to which it may go [m]."""


class SensorNode(Protocol):
    """Samples films on its channels, from 1 to the `channels` of its `DeviceKind`.

    Attributes:
        serial: its serial number; film calibrations are stored by that of the first node.
        ranges: greatest voltage of each input range, by its name [V].
        emergencies: emergency messages that it has sent so far.
    """

    serial: str
    ranges: Mapping[str, float]

    @property
    def emergencies(self) -> Sequence[bytes]: ...
    def set_sample_rate(self, rate: float) -> None:
        """Set the sample rate [Hz]."""

    def set_range(self, channel: int, range_: str) -> None: ...
    def resolution(self, channel: int) -> float:
        """Step of a channel's converter on its present range [V]."""

    def acquire_with(self, others: Sequence[Any], duration: float) -> list[Recording]:
        """Sample for `duration` [s] at the same moments as other nodes of its kind; its own recording is the first."""


@runtime_checkable
class SamplesInPieces(Protocol):
    """A sensor node that gives the samples of a long recording while it lasts; not every one can."""

    def pieces_with(self, others: Sequence[Any], duration: float) -> Generator[list[Recording], None, None]:
        """As `acquire_with`, but in pieces, each with all nodes. Sampling ends when the generator is closed."""


class Chamber(Protocol):
    """Warms the surroundings of the sensor."""

    def warm(self, kelvin: float) -> None:
        """Make the surroundings this much warmer than at the start [K], and wait until they are."""

    def off(self) -> None:
        """Stop heating and cooling, and do not wait. A bench that has warmed the sensor calls this when it ends."""


class SampleChanger(Protocol):
    """Puts samples under the probe, by their names.

    Attributes:
        samples: names of the samples that it holds.
    """

    samples: tuple[str, ...]

    def check_holds(self, names: Iterable[str]) -> None:
        """Raises UnknownName: it does not hold one of these samples."""

    def mount(self, name: str) -> None: ...
    def leave(self) -> None:
        """From now on a person may put anything under the probe."""

    def check(self) -> None:
        """Check that the sample that was mounted last is still there, if there is one and `leave` was not called since.

        The engine asks before it stores a point. Raises SampleError: it is not there, or was away meanwhile.
        """


class ProbeStage(Protocol):
    """Sets a point probe above a place of the sensor."""

    def place_probe(self, x: float, y: float) -> None:
        """Set the probe above (x, y) from the sensor's corner [m]; the positioner must be at home."""


class Bias(Protocol):
    """Holds one value, such as a direct voltage, for a laboratory's own procedure.

    Attributes:
        name: its name.
        holding: whether it was told to hold a value, and not told to stop.
    """

    name: str
    broken: str
    holding: bool

    def hold(self, level: float) -> None:
        """Hold a value, in its own unit. Raises RangeError: it cannot; nothing was sent."""

    def off(self) -> None:
        """Switch it off. A bench does so on every way out."""


_ROLES: dict[type, Role] = {
    Exciter: "exciter",
    LoadIndicator: "load_indicator",
    Positioner: "positioner",
    SensorNode: "sensor_node",
    SampleChanger: "sample_changer",
    Chamber: "chamber",
    ProbeStage: "probe_stage",
    Bias: "bias",
}


def role_of(asked: type) -> Role | None:
    """The name of a role in bench files and kinds; None: `asked` is no role, but a driver class."""
    return _ROLES.get(asked)
