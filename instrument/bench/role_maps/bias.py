"""What of a map serves a source that holds one value, and why it cannot shake the stack."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from palpate.instrument.bench.role_maps.role_map import RoleMap
from palpate.instrument.contracts.contract import Contract


class BiasMap(RoleMap):
    """The table `[role.bias]`.

    Attributes:
        level: field of the value that it holds.
        actual: field of the value that it measures at its output; "": it measures none.
        ready: command without which it takes no value; "": there is none.
        on: command that switches its output on; "": the output is always on.
        off: command that switches its output off; "": a level of zero must do.
        set_up: values that some fields must have before.
        no_sine: why it cannot be the exciter.
    """

    generic_driver: ClassVar[str] = "palpate.drivers.devices.bias:MappedBias"
    generic_simulator: ClassVar[str | None] = "palpate.simulators.devices.bias:SimulatedMappedBias"

    level: str
    actual: str = ""
    ready: str = ""
    on: str = ""
    off: str = ""
    set_up: dict[str, float | str] = Field(default_factory=dict)
    no_sine: Annotated[str, Field(min_length=1)]

    def wrong(self, contract: Contract) -> list[str]:
        """What the contract lacks that this table names, each with key, value and what is valid; empty: it fits."""
        fields = {f.name: f for f in contract.fields if f.type != "text"}
        written = [name for name, f in fields.items() if f.access == "rw"]
        commands = [command.name for command in contract.commands]
        found = [
            f"{key}: {name!r} is no number field that can be written and read; valid: {', '.join(written) or 'none'}"
            for key, name in (("level", self.level), *(("set_up", name) for name in self.set_up))
            if name not in written
        ]
        if self.actual and (self.actual not in fields or fields[self.actual].access == "wo"):
            found.append(f"actual = {self.actual!r} is no number field that can be read; valid: {', '.join(fields)}")
        found += [
            f"{key} = {name!r} is no command; valid: {', '.join(commands) or 'none'}"
            for key, name in (("ready", self.ready), ("on", self.on), ("off", self.off))
            if name and name not in commands
        ]
        if bool(self.on) != bool(self.off):
            found.append("on and off: give both, or none")
        return found

    def limits(self, contract: Contract) -> Mapping[str, Any]:
        """Attributes of `DeviceKind` that follow from the map."""
        return {"cannot": {"exciter": self.no_sine}}
