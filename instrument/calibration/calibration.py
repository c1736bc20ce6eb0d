"""What all calibrations that are kept for later runs have: a device to which they belong, a last day, a file's name."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import date, datetime
from typing import Annotated, ClassVar

from pydantic import Field

from palpate.instrument.config import Hashed, IsoDate, Name
from palpate.instrument.errors import ConfigError

ANY = "*"  # as the device of an owner: it is not known yet which one will answer
UNKNOWN = "unknown"  # the device that tells no serial number


@dataclass(frozen=True, slots=True)
class CalibrationOwner:
    """What a calibration belongs to, and to nothing else.

    Attributes:
        device: serial number of the device, `UNKNOWN`, or `ANY`.
        scene: identity of the scene that simulates the device; None: it is real, or nobody knows by which scene.
        simulated: whether it is simulated.
        of: what else tells apart what is calibrated there, as a sensor's design and a model.
    """

    device: str
    scene: str | None
    simulated: bool
    of: tuple[str, ...] = ()

    def __str__(self) -> str:
        of = f" ({', '.join(self.of)})" if self.of else ""
        return f"{self.device}{of}{f' of scene {self.scene}' if self.scene else ''}"

    def file_name(self, kind: str) -> str:
        """Name of the file of its calibration of a kind; with `ANY` as the device it is a pattern of all devices."""
        parts = (kind, self.device, *self.of, *([f"scene-{self.scene}"] if self.scene else []))
        return f"{'-'.join(part if part == ANY else _plain(part) for part in parts)}.toml"


def _plain(text: str) -> str:
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in text)


class Calibration(Hashed):
    """What was measured of a device, and is kept in a file for later runs. Field names are the keys of the file.

    Args:
        device: serial number of the device.
        scene: identity of the scene that simulates it; None: it is real, or nobody knows by which scene.
        simulated: whether a simulated bench measured it.
        source: name of the run.
        created: date and time, ISO 8601.
        expires: last day on which it may be used, ISO 8601; None: no limit was given.
    """

    kind: ClassVar[str]  # what the names of its files begin with
    make: ClassVar[str]  # how a new one is made

    device: Name
    scene: Name | None = None
    simulated: Annotated[bool, Field(strict=True)]
    source: Name
    created: Name
    expires: IsoDate | None = None

    @property
    def of(self) -> tuple[str, ...]:
        """What it is of beyond the device, as for `CalibrationOwner`."""
        return ()

    @property
    def owner(self) -> CalibrationOwner:
        """What it belongs to."""
        return CalibrationOwner(self.device, self.scene, self.simulated, self.of)

    def belongs_to(self, owner: CalibrationOwner) -> bool:
        """Whether it belongs to an owner, which may be of `ANY` device."""
        return self.owner == (replace(owner, device=self.device) if owner.device == ANY else owner)

    def check_owner(self, owner: CalibrationOwner) -> None:
        """Check that it belongs to an owner. Raises ConfigError."""
        if not self.belongs_to(owner):
            raise ConfigError(f"{self.made}, not for this bench's {owner}; {self.make}")

    def check_date(self, today: date) -> None:
        """Check that it has not expired. Raises ConfigError."""
        if not self.lasts_on(today):
            raise ConfigError(f"{self.made} and expired on {self.expires}; {self.make}, or delete it")

    def lasts_on(self, today: date) -> bool:
        """Whether it has not expired."""
        return self.expires is None or today <= date.fromisoformat(self.expires)

    def doubts(self, owner: CalibrationOwner, begun: datetime) -> list[str]:
        """What speaks against it for an owner, in a run that began at a time; for people."""
        found = []
        if not self.belongs_to(owner):
            found.append(f"of {self.owner}, not of this bench's {owner}")
        elif self.simulated and self.scene is None:
            found.append("nobody knows of which scene")
        if not self.lasts_on(begun.date()):
            found.append(f"expired on {self.expires}")
        if self.newer_than(begun):
            found.append(f"made after the run began, on {self.created}")
        return found

    @property
    def made(self) -> str:
        """Where and of what it was made, to go on after "it"."""
        return f"was made {'on a simulated bench' if self.simulated else 'on hardware'} with device {self.owner}"

    def newer_than(self, other: datetime) -> bool:
        """Whether it was made after a time; not if it does not tell when."""
        with suppress(ValueError, TypeError):  # no ISO 8601, or no time zone
            return datetime.fromisoformat(self.created) > other
        return False
