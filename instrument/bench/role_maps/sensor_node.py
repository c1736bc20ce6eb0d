"""What of a map makes a CANopen node a sensor node: fields that travel at each SYNC are the channels of films."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from palpate.instrument.bench.role_maps.role_map import RoleMap
from palpate.instrument.config import Config
from palpate.instrument.contracts.contract import Contract, sdo
from palpate.instrument.contracts.field import Field as ContractField

SYNC_COB_ID, SYNC_PERIOD = sdo(0x1005), sdo(0x1006)  # CiA 301
VOLTS = {"V": 1.0, "mV": 1e-3}  # units in which a node may tell volts itself
INTEGERS = ("int8", "int16", "int24", "int32", "uint8", "uint16", "uint24", "uint32")


class NodeSettings(Config):
    """The keys of such a node in a bench file.

    Attributes:
        volts_per_unit: what one unit of its readings stands for, or one count if they have no unit [V]; None: its
            readings are in V or mV.
        sync_node: node id of the node on its bus that sends SYNC; None: it sends SYNC itself.
    """

    volts_per_unit: Annotated[float, Field(ge=1e-9, le=1e3, strict=True)] | None = None
    sync_node: Annotated[int, Field(ge=1, le=127, strict=True)] | None = None


class SensorNodeMap(RoleMap):
    """The table `[role.sensor_node]`.

    Attributes:
        channels: the fields of its channels, from channel 1 on. Each is an integer, and in one of the PDOs that the
            node sends; a reading at the end of its range counts as saturated.
        sends_sync: whether the node can send SYNC (1005h and 1006h).
        fastest: greatest number of samples a second.
        status: a field with choices of which `ok` says that readings are good; None: there is none.
    """

    generic_driver: ClassVar[str] = "palpate.drivers.devices.sensor_node:MappedNode"
    generic_simulator: ClassVar[str | None] = "palpate.simulators.devices.sensor_node:SimulatedMappedNode"
    settings: ClassVar[type[Config] | None] = NodeSettings

    channels: Annotated[tuple[str, ...], Field(min_length=1, max_length=64)]
    sends_sync: bool = False
    fastest: Annotated[float, Field(gt=0, le=1e5, strict=True)] = 1000.0
    status: str | None = None

    def wrong(self, contract: Contract) -> list[str]:
        if contract.bus != "canopen":
            return ["channels: a node that samples at SYNC is on CANopen; this device is on Modbus"]
        sent = [name for pdo in contract.pdos for name in pdo.fields]
        able = [name for name in dict.fromkeys(sent) if contract[name].type in INTEGERS]
        valid = ", ".join(able) or "none"
        problems = [f"channels: {name!r} is no integer that a PDO sends; valid: {valid}" for name in self.channels
                    if name not in able]  # fmt: skip
        if twice := {name for name in self.channels if self.channels.count(name) > 1 or sent.count(name) > 1}:
            problems.append(f"channels: {', '.join(sorted(twice))} would come twice at each SYNC; name each once")
        if not problems and len({contract[name].unit for name in self.channels}) > 1:
            problems.append("channels: they have several units; a node has one `volts_per_unit` for all")
        problems += [
            f"channels: PDO {pdo.name} has transmission = {pdo.transmission}; give 1, so that it answers every SYNC"
            for pdo in contract.pdos
            if (pdo.index or pdo.fixed) and pdo.transmission != 1 and set(pdo.fields) & {*self.channels}
        ]
        writable = {f.address for f in contract.fields if f.access == "rw"}
        if self.sends_sync and not {SYNC_COB_ID, SYNC_PERIOD} <= writable:
            problems.append("sends_sync: needs fields at 1005:0 and 1006:0 that can be written")
        if self.status is not None and not (contract.has(self.status) and "ok" in contract[self.status].choices):
            problems.append(f"status: {self.status!r} is no field with a choice `ok`")
        return problems

    def limits(self, contract: Contract) -> Mapping[str, Any]:
        return {"channels": len(self.channels)}


def raw_limits(f: ContractField, step: float) -> tuple[int, int]:
    """Least and greatest raw value of a channel: its limits, or else those of its type, alike for either sign."""
    bits = 8 * f.size
    low, high = (1 - (1 << bits - 1), (1 << bits - 1) - 1) if f.type.startswith("int") else (0, (1 << bits) - 1)
    least, most = (f.minimum, f.maximum) if step > 0 else (f.maximum, f.minimum)
    return (
        low if least is None else max(low, round((least - f.offset) / step)),
        high if most is None else min(high, round((most - f.offset) / step)),
    )
