"""Links of a bench, over which one or more of its devices are reached."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from palpate.instrument.config import Config, check
from palpate.instrument.contracts.maps.map_file import Baudrate, Bitrate
from palpate.instrument.errors import ConfigError
from palpate.instrument.quantity import Seconds

LINE, CAN = "line", "can"  # links of a simulated bench that several devices share; faults strike them by these names
Timeout = Annotated[Seconds, Field(ge=1e-3, le=60)]


# a URL, or a host with a port; the host alone is a name, an IPv4 address, or an IPv6 address with colons of its own
URL = re.compile(r"([\w+.-]+://)?(?P<host>\[[^\]]+\]|[^:/\[\]\s]+)(:(?P<port>\d+))?(/.*)?")


def _alone(host: str) -> str:
    """A host as it is. Raises ValueError: it is a URL, or has a port."""
    found = URL.fullmatch(host)
    bare = found["host"].strip("[]") if found else host
    if found is None or bare == host:
        return host
    port = f" and port = {found['port']}" if found["port"] else ""
    raise ValueError(f'{host!r} is no host alone; write host = "{bare}"{port}')


Host = Annotated[str, Field(min_length=1), AfterValidator(_alone)]


class TcpLink(Config):
    """A Modbus TCP address, of one device or of a gateway with several units."""

    host: Host
    port: int = Field(default=502, ge=1, le=65535, strict=True)
    timeout: Timeout = 1.0


class SerialLine(Config):
    """A Modbus RTU line, which one or more devices share."""

    port: str = Field(min_length=1)
    baudrate: Baudrate = 115200
    parity: Literal["N", "E", "O"] = "N"
    stopbits: int = Field(default=1, ge=1, le=2, strict=True)
    timeout: Timeout = 1.0


class CanBus(Config):
    """A CAN bus."""

    interface: str = Field(min_length=1)
    channel: str
    bitrate: Bitrate = 1_000_000
    timeout: Timeout = 1.0


Link = TcpLink | SerialLine | CanBus
LINKS: dict[str, type[Link]] = {"modbus-tcp": TcpLink, "modbus-rtu": SerialLine, "canopen": CanBus}
KIND_OF = {model: kind for kind, model in LINKS.items()}


def link_of(table: dict[str, Any], where: str) -> Link:
    """The link of a `[link.NAME]` table. Raises ConfigError: the table is wrong."""
    kind = table.pop("kind", None)
    if kind not in LINKS:
        raise ConfigError(f"{where}: kind: {kind!r} is no kind of link; valid: {', '.join(LINKS)}")
    return check(table, LINKS[kind], where)
