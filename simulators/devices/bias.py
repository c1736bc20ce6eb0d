"""The twin of a source that holds one value. Nothing of the rig is joined to its output."""

from __future__ import annotations

from palpate.instrument.bench.role_maps import BiasMap
from palpate.instrument.contracts.contract import Command
from palpate.simulators.devices.twin import Twin
from palpate.simulators.wire.device import DEVICE_FAILURE, Refused, SimulatedPlace


class SimulatedMappedBias(Twin):
    """A source: it takes a value only when it is ready, and gives it only when its output is on."""

    def __init__(self, place: SimulatedPlace) -> None:
        self._map = place.kind.table(BiasMap)
        super().__init__(place)

    def write(self, values: dict[str, float]) -> None:
        if self._map.level in values and not self._is(self._map.ready):
            raise Refused(DEVICE_FAILURE)
        super().write(values)

    def check(self, command: Command) -> None:
        if not all(self._is(name) for name in command.after):
            raise Refused(DEVICE_FAILURE)

    def _is(self, name: str) -> bool:
        """Whether a command has been carried out; one without a state counts as carried out."""
        done = self.contract.command(name).done if name else None
        return done is None or done.holds(self.contract[done.field].to_raw(self.settings[done.field]))

    @property
    def output(self) -> float:
        """What it gives now, in the unit of its level."""
        return self.settings[self._map.level] if self._is(self._map.on) else 0.0

    def read(self, name: str) -> float:
        return self.output if name == self._map.actual else super().read(name)
