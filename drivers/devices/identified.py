"""How a device is known: by its identity objects, by marks in its fields, or by a person alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from palpate.drivers.devices.device import Device
from palpate.drivers.links.requests import BASIC, EXTENDED, REGULAR, read_identity
from palpate.instrument.contracts.contract import Mark
from palpate.instrument.contracts.field import told_text
from palpate.instrument.errors import DeviceError, IdentityError

VENDOR, PRODUCT, REVISION, APPLICATION, SERIAL = 0, 1, 2, 6, 0x80  # numbers of identity objects


def identity_objects(transact: Callable[..., Any]) -> dict[int, str]:
    """Identity objects by number (function 43/14); lower categories are asked for if the extended one leaves them out.

    `transact` sends a request with its arguments but the unit. Raises LinkError, LinkTimeout, DeviceError.
    """

    def category(number: int) -> dict[int, str]:
        reply = transact(read_identity, number)
        return {k: told_text(v) for k, v in getattr(reply, "information", {}).items()}

    objects = category(EXTENDED)
    if VENDOR not in objects:
        objects |= category(BASIC) | category(REGULAR)
    return objects


def check_objects(device: Device, objects: Mapping[int, str]) -> None:
    """Check identity objects, by number, against the contract.

    Raises:
        IdentityError: another vendor, product or major version.
    """
    expected = device.contract.identity
    found = (objects.get(VENDOR, ""), objects.get(PRODUCT, ""), objects.get(REVISION, ""))
    wanted = (expected.vendor, expected.product, expected.revision)
    major = (*found[:2], found[2].split(".")[0])
    if any(text and given != text for given, text in zip(major, (*wanted[:2], wanted[2].split(".")[0]), strict=True)):
        raise IdentityError(
            f"{device.name}: identifies itself as {' '.join(found).strip() or 'nothing'}, the contract is for "
            f"{' '.join(wanted).strip()}; check the address and unit id in the bench file"
        )


def check_marks(device: Device) -> None:
    """Check that each mark of the contract fits.

    Raises:
        IdentityError: another device answers; the message names what was found and wanted.
        LinkError, LinkTimeout: none answers.
    """
    for mark in device.contract.marks:
        found = _found(device, mark)
        fits = found.startswith(str(mark.value)) if isinstance(found, str) else _equal(device, mark, found)
        if not fits:
            shown = repr(found) if isinstance(found, str) else f"{found:.10g}"
            raise IdentityError(
                f"{device.name}: {mark.field} reads {shown}, should "
                + (f"begin with {mark.value!r}" if isinstance(mark.value, str) else f"be {mark.value:.10g}")
                + "; this is another device or firmware: check the address in the bench file",
                device=device.name,
            )


def _equal(device: Device, mark: Mark, found: float) -> bool:
    f = device.contract[mark.field]
    return found == found and f.to_raw(found) == f.to_raw(float(mark.value))


def _found(device: Device, mark: Mark) -> float | str:
    try:
        return device.get_text(mark.field) if isinstance(mark.value, str) else device.held(mark.field)
    except DeviceError as error:
        raise IdentityError(
            f"{device.name}: cannot read {mark.field}, by which it is known ({error}); this is another device or "
            "firmware: check the address in the bench file",
            device=device.name,
        ) from None


def check_inventory(device: Device) -> None:
    """Check that the bench file names a device that tells nothing of itself, and that one answers at its address.

    Raises:
        IdentityError: the bench file does not name it.
        LinkError, LinkTimeout: none answers.
    """
    if not device.inventory:
        raise IdentityError(
            f'{device.name}: tells nothing by which it is known; write inventory = "LABEL" in its section of the bench '
            "file, as it is labelled",
            device=device.name,
        )
    readable = [f.name for f in device.contract.fields if f.access != "wo" and f.type != "text" and not f.beside]
    if readable:
        device.held(readable[0])


def serial_number(device: Device) -> str:
    """Its serial number from the field that the contract names, or its label. Raises LinkError, DeviceError."""
    name = device.contract.serial
    if not name:
        return device.inventory
    if device.contract[name].type == "text":
        return device.get_text(name)
    return f"{device.held(name):.20g}"
