"""What a device wants beside the right registers: how it is known, how it takes orders, how fast it may be asked."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.instrument.contracts.field import Value
from palpate.instrument.errors import ConfigError

MOST_READ, MOST_WRITTEN = 125, 123  # registers of one request ("MODBUS application protocol" 1.1b3, 6.3 and 6.12)
LARGEST_UNIT = 247
ITSELF = (0, 255)  # units of the device at a TCP address itself ("MODBUS Messaging on TCP/IP" 1.0b, 4.4.1.2)


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity that a device reports (Modbus function 43/14, CANopen object 0x1018)."""

    vendor: str
    product: str
    revision: str


@dataclass(frozen=True, slots=True)
class Mark:
    """What a field reads on each device of a kind, by which one without an identity object is known.

    Attributes:
        field: name of the field.
        value: its value; of a text, how it begins.
    """

    field: str
    value: Value


@dataclass(frozen=True, slots=True)
class Condition:
    """A state of a device: a field that reads one of some raw values.

    Attributes:
        field: name of the field.
        values: the raw values.
        mask: bits of it that count, as of a CiA 402 status word; None: all.
    """

    field: str
    values: tuple[int, ...]
    mask: int | None = None

    def holds(self, raw: float) -> bool:
        """Whether a raw value of the field fulfils it; one that is no whole number never does."""
        if not math.isfinite(raw) or raw != int(raw):
            return False
        return (int(raw) if self.mask is None else int(raw) & self.mask) in self.values


@dataclass(frozen=True, slots=True)
class Command:
    """An order that is given by writing a code, with the handshake that the device wants.

    Attributes:
        name: its name.
        field: name of the field that is written.
        value: what is written: a value in the field's unit, a choice, or a text.
        after: names of the commands that must be given before it, in order.
        done: state in which it is carried out; None: a confirmed write is all that can be known.
        failed: state in which the device has refused it.
        clear: value that is written when it is done, so that it can be given again; None: the device clears it.
        seconds: longest time that it may take [s].
    """

    name: str
    field: str
    value: Value
    after: tuple[str, ...] = ()
    done: Condition | None = None
    failed: Condition | None = None
    clear: Value | None = None
    seconds: float = 1.0

    def __post_init__(self) -> None:
        """Raises ConfigError: its time limit makes no sense."""
        if not (math.isfinite(self.seconds) and 0 < self.seconds <= 600):
            raise ConfigError(f"command {self.name}: seconds = {self.seconds:g}; give more than 0, up to 600")


@dataclass(frozen=True, slots=True)
class Manners:
    """Limits of a device on its bus.

    Attributes:
        most_read: greatest number of registers that it gives in one reply.
        most_written: greatest number of registers that it takes in one request.
        gap: shortest silence between a reply and the next request [s], beside that of the line itself.
        responds: longest time until it begins to reply [s], if that exceeds the link's time-out; None: it does not.
        busy: longest time for which it may answer that it is busy (exception 6), or still at work on what it has
            acknowledged (exception 5), before that counts as a failure [s]; 0: the first such answer does.
        units: least and greatest unit id at which it can answer.
        together: runs of fields that a request must write whole, or else they are half old and half new.
    """

    most_read: int = MOST_READ
    most_written: int = MOST_WRITTEN
    gap: float = 0.0
    responds: float | None = None
    busy: float = 1.0
    units: tuple[int, int] = (1, LARGEST_UNIT)
    together: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        """Check that the limits are possible. Raises ConfigError."""
        low, high = self.units
        for what, given, least, most in (
            ("most_read", self.most_read, 1, MOST_READ),
            ("most_written", self.most_written, 1, MOST_WRITTEN),
            ("gap", self.gap, 0, 10),
            ("responds", 1.0 if self.responds is None else self.responds, 1e-4, 60),
            ("busy", self.busy, 0, 60),
            ("units", low, 0, high),
            ("units", high, low, LARGEST_UNIT),
        ):
            if not least <= given <= most:
                raise ConfigError(f"manners: {what} = {given:g} is outside {least:g} to {most:g}")


USUAL = Manners()  # those of a device of which nothing is known
