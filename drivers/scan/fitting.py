"""Which kinds of device one that answers can be: by the same checks by which a bench knows its devices."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from palpate.drivers.devices.canopen_node import CanopenNode
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.bench.kinds import DeviceKind
from palpate.instrument.errors import BenchError, DeviceError, IdentityError, LinkTimeout

UNNAMED = "?"  # a label, so that a device that tells nothing of itself may be asked at all


@dataclass
class Fitting:
    """The kinds that fit; the attributes are those of `FoundDevice`."""

    fits: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()
    serial: str = ""
    doubt: str = ""


def fitting(kinds: Iterable[DeviceKind], driver: Callable[[DeviceKind], ModbusDevice | CanopenNode]) -> Fitting:
    """The kinds whose marks or identity fit, and those that cannot be told from others.

    Args:
        kinds: kinds that can be on this link.
        driver: makes the generic driver of a kind for the device.
    """
    found = Fitting()
    for kind in kinds:
        device = driver(kind)
        if kind.contract.known_by == "nothing":
            device.inventory = UNNAMED
        try:
            if isinstance(device, CanopenNode):
                device.join()
            device.recognise()
        except (IdentityError, DeviceError, LinkTimeout):
            continue
        if kind.contract.known_by == "nothing":
            found.candidates += (kind.name,)
            continue
        found.fits += (kind.name,)
        try:
            device.identify()
        except BenchError as error:
            found.doubt = str(error)
        found.serial = found.serial or device.serial
    return found
