"""Sections of the usual devices in a bench file; each says in one place where a link is and what is on it."""

from __future__ import annotations

from pydantic import Field, field_validator

from palpate.instrument.bench.kinds import AmplifierSettings, IndicatorSettings
from palpate.instrument.bench.links import Host, Timeout
from palpate.instrument.bench.listed import NodeId, Unit
from palpate.instrument.config import Config

LINE, CAN = "line", "can"  # sections that are links of several devices
ON_TCP, ON_LINE = ("signal_generator", "shaker_amplifier", "sample_changer"), ("strain_indicator", "positioner")
NEEDED = ("signal_generator", "shaker_amplifier", LINE, CAN)  # needed if a bench file lists no other devices
LINKING = {  # sections that say where a link is, with the kind of the link
    "signal_generator": "modbus-tcp",
    "shaker_amplifier": "modbus-tcp",
    LINE: "modbus-rtu",
    CAN: "canopen",
    "sample_changer": "modbus-tcp",
}
POSITIONER_UNIT = 2


class TcpAddress(Config):
    """A Modbus TCP device."""

    host: Host
    port: int = Field(default=502, ge=1, le=65535, strict=True)
    unit: Unit = 1
    timeout: Timeout = 1.0


class Amplifier(AmplifierSettings, TcpAddress):
    """The shaker amplifier."""


class RtuAddress(Config):
    """A unit on the serial line."""

    unit: Unit


class Indicator(IndicatorSettings, RtuAddress):
    """The strain indicator."""

    unit: Unit = 1


class CanBus(Config):
    """The CAN bus and the sensor nodes on it; the first node produces SYNC."""

    interface: str = Field(min_length=1)
    channel: str
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000, strict=True)
    nodes: tuple[NodeId, ...] = Field(min_length=1, max_length=20)
    timeout: Timeout = 1.0

    @field_validator("nodes")
    @classmethod
    def _distinct(cls, nodes: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(nodes)) != len(nodes):
            raise ValueError(f"node ids {list(nodes)} repeat; each node needs its own")
        return nodes
