"""Device kinds made from map files, without a line of Python."""

from __future__ import annotations

from functools import cache

from pydantic import create_model

from palpate.instrument.bench.kind import DeviceKind, NoSettings
from palpate.instrument.bench.role_maps import ROLE_MAPS
from palpate.instrument.bench.role_maps.role_map import RoleMap
from palpate.instrument.config import check
from palpate.instrument.contracts.maps.golden_frames import prove
from palpate.instrument.contracts.maps.map_file import DeviceMap
from palpate.instrument.errors import ConfigError, UnknownName

# driver and simulator of a map without a role, whose fields a laboratory's own procedure reads and writes
PLAIN: dict[str, tuple[str, str | None]] = {
    "modbus": ("palpate.drivers.devices.modbus_device:ModbusDevice", None),
    "canopen": ("palpate.drivers.devices.canopen_device:CanopenDevice", None),
}


@cache
def kind_of(found: DeviceMap) -> DeviceKind:
    """The device kind that a map describes.

    Raises ConfigError: one of its frames does not fit, or the table of a role is wrong.
    """
    if problems := prove(found.contract, found.frames).problems:
        raise ConfigError("\n".join(f"{found.file}: {problem}" for problem in problems))
    served = serves(found)
    first = next(iter(served.values()), None)
    driver, simulator = PLAIN[found.contract.bus]
    if first is not None:
        driver, simulator = first.generic_driver, first.generic_simulator
    limits = {key: value for each in served.values() for key, value in each.limits(found.contract).items()}
    settings = [each.settings for each in served.values() if each.settings is not None]
    return DeviceKind(
        found.contract,
        found.links,
        driver,
        simulator,
        settings[0] if len(settings) == 1 else create_model("Settings", __base__=(*settings, NoSettings)),
        tuple(served),  # type: ignore[arg-type]  # the keys of ROLE_MAPS are roles
        **limits,
        map=found,
        serves=served,
    )


def serves(found: DeviceMap) -> dict[str, RoleMap]:
    """The checked table of each role of a map. Raises ConfigError."""
    found_for: dict[str, RoleMap] = {}
    for role, table in found.roles.items():
        where = f"{found.file}: role.{role}"
        if role not in ROLE_MAPS:
            raise ConfigError(f"{where}: {UnknownName('role of a map', role, ROLE_MAPS)}")
        found_for[role] = check(dict(table), ROLE_MAPS[role], where)
        if problems := found_for[role].wrong(found.contract):
            raise ConfigError("\n".join(f"{where}: {problem}" for problem in problems))
    return found_for
