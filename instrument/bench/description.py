"""Description of a bench: the address of each device, its settings and the bench's limits.

A simulated bench differs from a real one only in the addresses of this description.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from palpate.instrument.bench.serial_line import FASTEST
from palpate.instrument.config import Config, read
from palpate.instrument.errors import UnknownName
from palpate.instrument.quantity import Amperes, Newtons, Seconds, Volts
from palpate.instrument.sensor.designs import get_design

Unit = Annotated[int, Field(ge=1, le=247, strict=True)]
Timeout = Annotated[Seconds, Field(gt=0, le=60)]


class TcpAddress(Config):
    """A Modbus TCP device."""

    host: str = Field(min_length=1)
    port: int = Field(default=502, ge=1, le=65535, strict=True)
    unit: Unit = 1
    timeout: Timeout = 1.0


class Amplifier(TcpAddress):
    """The shaker amplifier, its settings, and what feeds its watchdog: only its owner, or any request of any client."""

    watchdog_fed_by: Literal["owner", "any request"] = "owner"
    gain: float = Field(default=2.0, ge=0, le=20, strict=True)  # V/V [A]
    current_limit: Amperes = Field(default=5.0, ge=0.1, le=6)  # peak [A]


class SerialLine(Config):
    """The Modbus RTU line that strain indicator and positioner share."""

    port: str = Field(min_length=1)
    baudrate: int = Field(default=115200, ge=1200, le=FASTEST, strict=True)
    parity: Annotated[str, Field(pattern="^[NEO]$")] = "N"
    stopbits: int = Field(default=1, ge=1, le=2, strict=True)
    timeout: Timeout = 1.0


class RtuAddress(Config):
    """A unit on the serial line."""

    unit: Unit


class Indicator(RtuAddress):
    """The strain indicator and its settings."""

    unit: Unit = 1
    gage_factor: float = Field(default=8.98, ge=0.5, le=20, strict=True)  # [T]
    full_scale: Volts = Field(default=0.2, ge=0.01, le=30)  # reading above which overload is flagged [A]


class CanBus(Config):
    """The CAN bus and the sensor nodes on it; the first node produces SYNC."""

    interface: str = Field(min_length=1)
    channel: str
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000, strict=True)
    nodes: tuple[Annotated[int, Field(ge=1, le=127, strict=True)], ...] = Field(min_length=1, max_length=20)
    timeout: Timeout = 1.0

    @field_validator("nodes")
    @classmethod
    def _distinct(cls, nodes: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(nodes)) != len(nodes):
            raise ValueError(f"node ids {list(nodes)} repeat; each node needs its own")
        return nodes


class BenchDescription(Config):
    """A whole bench file."""

    name: str
    design: str = "single"
    force_limit: Newtons = Field(default=10.0, gt=0)
    watchdog: Seconds = Field(default=2.0, ge=0.1, le=60)
    # Share of the load that a film's moving cable adds to its force in step with the drive, at most; 0: not known.
    pickup: float = Field(default=0.0, ge=0, le=0.5, strict=True)
    signal_generator: TcpAddress
    shaker_amplifier: Amplifier
    line: SerialLine
    strain_indicator: Indicator = Indicator()
    positioner: RtuAddress = RtuAddress(unit=2)
    can: CanBus
    sample_changer: TcpAddress | None = None  # without one a person mounts the samples

    @field_validator("design")
    @classmethod
    def _known(cls, design: str) -> str:
        try:
            return get_design(design).name
        except UnknownName as error:
            raise ValueError(str(error)) from None

    def to_toml(self) -> str:
        """The bench file that reads back as this description."""
        import tomli_w

        data: dict[str, Any] = self.model_dump(mode="json", exclude_none=True)
        return tomli_w.dumps(data)


def read_bench(path: Path) -> BenchDescription:
    """Read a bench file. Raises ConfigError."""
    return read(path, BenchDescription)
