"""What is read beside each point of a run: a field of any device of the bench, such as a thermometer's temperature.

[beside.room]                 # in a bench or scene file
device = "thermometer"        # its section: [device.thermometer]
field = "temperature"         # of the device's contract
unit = "degC"                 # that of the contract, so that no other is taken for it
u = 0.3                       # standard uncertainty of a reading, in that unit
low = 18.0
high = 28.0
outside = "invalidate"        # the point is not used; "mark" (the default) only marks it
every = "60 s"                # a reading serves all points of so long a time; without it each point has its own
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, model_validator

from palpate.instrument.config import Config, Name
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.quantity import Seconds

if TYPE_CHECKING:
    from palpate.instrument.contracts.contract import Contract

COLUMNS = "beside_"  # begins the names of values in records
KEY = re.compile(r"[a-z][a-z0-9_]{0,39}")
Number = Annotated[float, Field(strict=True)]


class Beside(Config):
    """A `[beside.NAME]` table; its numbers are in `unit`."""

    device: Name
    field: Name
    unit: str = ""
    u: Number | None = Field(default=None, ge=0)
    low: Number | None = None
    high: Number | None = None
    outside: Literal["mark", "invalidate"] = "mark"
    every: Seconds | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low = {self.low:g} is not below high = {self.high:g}; exchange them")
        if self.outside == "invalidate" and self.low is None and self.high is None:
            raise ValueError('outside = "invalidate" needs a limit; give low, high or both')
        return self

    def column(self, name: str) -> str:
        """Name of the value in records, as beside_room_degC; that of its standard uncertainty has _u behind it."""
        unit = re.sub(r"[^A-Za-z0-9]+", "_", self.unit).strip("_")
        return COLUMNS + "_".join(part for part in (name, unit) if part)

    def columns(self, name: str) -> list[str]:
        """The names of all its values in records."""
        own = self.column(name)
        return [own] if self.u is None else [own, f"{own}_u"]

    def limits(self) -> str:
        """The limits for people."""
        unit = f" {self.unit}" if self.unit else ""
        if self.low is None:
            return f"at most {self.high:g}{unit}"
        return f"at least {self.low:g}{unit}" if self.high is None else f"{self.low:g} to {self.high:g}{unit}"

    def holds(self, value: float) -> bool:
        """Whether a value is within the limits."""
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)


def check_beside(asked: Mapping[str, Beside], known: Mapping[str, Contract]) -> None:
    """Check what is asked for beside each point against the contracts of a bench's devices, by their names.

    Raises ConfigError: a name cannot be one, there is no such device, field or unit, or two would have one column.
    """
    owners: dict[str, str] = {}
    for name, given in asked.items():
        where = f"beside.{name}"
        if not KEY.fullmatch(name):
            raise ConfigError(f"{where}: {name!r} is no name; give small letters, digits and _, such as room_2")
        try:
            if given.device not in known:
                raise UnknownName("device of this bench", given.device, known)
            _check_field(given, known[given.device])
        except (ConfigError, UnknownName) as error:
            raise ConfigError(f"{where}: {error}") from None
        for column in given.columns(name):
            if (other := owners.setdefault(column, name)) != name:
                raise ConfigError(f"{where}: it has the column {column} of beside.{other}, too; give it another name")


def _check_field(given: Beside, contract: Contract) -> None:
    readable = {field.name: field for field in contract.fields if field.access != "wo" and field.type != "text"}
    if given.field not in readable:
        raise UnknownName(f"field of {given.device} that can be read", given.field, readable)
    if (unit := readable[given.field].unit) != given.unit:
        told = f"has the unit {unit}" if unit else "has no unit"
        raise ConfigError(f"unit: {given.field} of {given.device} {told}, not {given.unit!r}; write unit = {unit!r}")
