"""Which device sits at which address, and the limits of the bench.

A simulated bench differs from a real one only in the addresses of this description.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_validator

from instrument.config import Config, read
from instrument.quantity import Newtons, Seconds

Unit = Annotated[int, Field(ge=1, le=247)]


class TcpAddress(Config):
    """A Modbus TCP device."""

    host: str = Field(min_length=1)
    port: int = Field(default=502, ge=1, le=65535)
    unit: Unit = 1
    timeout: Seconds = 1.0


class SerialLine(Config):
    """The Modbus RTU line that strain indicator and positioner share."""

    port: str = Field(min_length=1)
    baudrate: int = Field(default=115200, ge=1200, le=4_000_000)
    parity: Annotated[str, Field(pattern="^[NEO]$")] = "N"
    stopbits: int = Field(default=1, ge=1, le=2)
    timeout: Seconds = 1.0


class RtuAddress(Config):
    """A unit on the serial line."""

    unit: Unit


class CanBus(Config):
    """The CAN bus and the sensor nodes on it; the first node produces SYNC."""

    interface: str = Field(min_length=1)
    channel: str
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000)
    nodes: tuple[Annotated[int, Field(ge=1, le=127)], ...] = Field(min_length=1, max_length=20)
    timeout: Seconds = 1.0

    @field_validator("nodes")
    @classmethod
    def _distinct(cls, nodes: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(nodes)) != len(nodes):
            raise ValueError(f"node ids {list(nodes)} repeat; each node needs its own")
        return nodes


class BenchDescription(Config):
    """A whole bench file."""

    name: str
    force_limit: Newtons = Field(default=10.0, gt=0)
    watchdog: Seconds = Field(default=2.0, ge=0.1, le=60)
    signal_generator: TcpAddress
    shaker_amplifier: TcpAddress
    line: SerialLine
    strain_indicator: RtuAddress = RtuAddress(unit=1)
    positioner: RtuAddress = RtuAddress(unit=2)
    can: CanBus

    def to_toml(self) -> str:
        """The bench file that reads back as this description."""
        import tomli_w

        data: dict[str, Any] = self.model_dump(mode="json")
        return tomli_w.dumps(data)


def read_bench(path: Path) -> BenchDescription:
    """Read a bench file. Raises ConfigError."""
    return read(path, BenchDescription)
