"""Writes the first files of a new device from templates; they pass its conformance suite as they are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from palpate.procedures.templates.new_files import class_of, write_files, write_package

FILES = {
    "contract.py.txt": "instrument/contracts/{}.py",
    "driver.py.txt": "drivers/devices/{}.py",
    "simulator.py.txt": "simulators/devices/{}.py",
    "golden.toml.txt": "tests/golden/{}.toml",
    "test.py.txt": "tests/drivers/test_{}.py",
}


@dataclass(frozen=True, slots=True)
class Modbus:
    """The terms in a device's files that differ between the Modbus links."""

    title: str
    suite: str
    address: str
    imports: str
    serve: str


MODBUS = {
    "modbus-tcp": Modbus(
        "Modbus TCP",
        "ModbusConformance",
        "TcpAddress",
        "LOOPBACK, ServerThread",
        'link = ModbusLink.tcp(TcpAddress(host=LOOPBACK, port=servers.serve_tcp(UNIT, sim), timeout="10 s"))',
    ),
    "modbus-rtu": Modbus(
        "Modbus RTU",
        "RtuConformance",
        "SerialLine",
        "ServerThread",
        'link = ModbusLink.rtu(SerialLine(port=servers.serve_rtu({UNIT: sim}, None), timeout="10 s"))',
    ),
}
CANOPEN = "canopen"
BUSES = (*MODBUS, CANOPEN)
PACKAGE = {
    "package/pyproject.toml.txt": "pyproject.toml",
    "package/device.py.txt": "{}.py",
    "package/golden.toml.txt": "tests/{}.toml",
    "package/test.py.txt": "tests/test_{}.py",
}


def new_package(name: str, bus: str, folder: Path) -> list[Path]:
    """Write a package with a Modbus device of its own into a new folder of that name; `bus` is one of `MODBUS`.

    Its identity holds its whole name, so that no two packages have the same.

    Raises:
        UsageError: no name of a module, or the folder exists; nothing is written.
        RecordError: a file cannot be written.
    """
    project, modbus = name.replace("_", "-"), MODBUS[bus]
    terms = {
        "project": project,
        "product": project.upper(),
        "bus": modbus.title,
        "link": bus,
        "Suite": modbus.suite,
    }
    return write_package("device", name, PACKAGE, folder, terms)


def new_device(name: str, bus: str, tree: Path) -> list[Path]:
    """Write contract, driver, simulator, golden frames and test of a device into a source tree of palpate.

    Args:
        name: name of its modules, such as `force_gauge`.
        bus: one of `BUSES`.

    Returns:
        The files, in that order.

    Raises:
        UsageError: no name of a module, no such tree, or a file of the device exists; nothing is written.
        RecordError: a file cannot be written.
    """
    if bus == CANOPEN:
        files = {f"{CANOPEN}/{template}": place for template, place in FILES.items()}
        return write_files("device", name, files, tree, _canopen_terms(name))
    return write_files("device", name, FILES, tree, _modbus_terms(name, MODBUS[bus]), beside=str(MODBUS[bus]))


def _modbus_terms(name: str, bus: Modbus) -> dict[str, str]:
    title = " ".join(name.split("_"))
    product, serial = f"{_initials(name)}-1", f"SIM-{_initials(name)}-0001"
    identity = {0: "Palpate", 1: product, 2: "1.0", 4: title, 6: "simulated", 0x80: serial}
    return {
        "product": product,
        "serial": serial,
        "identity": "\n  ".join(
            f"{number:02X} {len(text):02X} {text.encode().hex(' ').upper()}" for number, text in identity.items()
        ),
        "bus": bus.title,
        "Suite": bus.suite,
        "Address": bus.address,
        "drivers": _imports(name, "from palpate.drivers.links.modbus import ModbusLink"),
        "imports": bus.imports,
        "serve": bus.serve,
    }


def _canopen_terms(name: str) -> dict[str, str]:
    product = _initials(name).encode()[:2].ljust(2, b"\0") + b"\0\1"  # two letters and a number
    return {
        "product": product.hex().upper(),
        "product_bytes": product[::-1].hex(" ").upper(),
        "drivers": _imports(name, "from palpate.drivers.links.can import CanLink"),
    }


def _initials(name: str) -> str:
    return "".join(word[:1] for word in name.split("_")).upper()


def _imports(name: str, link: str) -> str:
    return "\n".join(sorted([f"from palpate.drivers.devices.{name} import {class_of(name)}", link]))
