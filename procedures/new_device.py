"""The files of a new device, in the style of the others: they pass its conformance suite as they stand."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from procedures.new_files import class_of, write_files

FILES = {
    "contract.py.txt": "instrument/contracts/{}.py",
    "driver.py.txt": "drivers/{}.py",
    "simulator.py.txt": "simulators/{}.py",
    "golden.toml.txt": "tests/golden/{}.toml",
    "test.py.txt": "tests/drivers/test_{}.py",
}


@dataclass(frozen=True, slots=True)
class Bus:
    """What differs between the buses: the terms in the device's files."""

    title: str
    suite: str
    address: str
    imports: str
    serve: str


BUSES = {
    "modbus-tcp": Bus(
        "Modbus TCP",
        "ModbusConformance",
        "TcpAddress",
        "LOOPBACK, ServerThread",
        'link = ModbusLink.tcp(TcpAddress(host=LOOPBACK, port=servers.serve_tcp(UNIT, sim), timeout="10 s"))',
    ),
    "modbus-rtu": Bus(
        "Modbus RTU",
        "RtuConformance",
        "SerialLine",
        "ServerThread",
        'link = ModbusLink.rtu(SerialLine(port=servers.serve_rtu({UNIT: sim}, None), timeout="10 s"))',
    ),
}


def new_device(name: str, bus: str, tree: Path) -> list[Path]:
    """Write contract, driver, simulator, golden frames and test of a device into a source tree of palpate.

    Args:
        name: of its modules, such as `force_gauge`.
        bus: one of `BUSES`.

    Returns:
        The files, in that order.

    Raises:
        UsageError: no name of a module, no such tree, or a file of the device exists; nothing is written.
        RecordError: a file cannot be written.
    """
    return write_files("device", name, FILES, tree, _terms(name, BUSES[bus]), beside=str(BUSES[bus]))


def _terms(name: str, bus: Bus) -> dict[str, str]:
    words = name.split("_")
    title = " ".join(words)
    initials = "".join(word[:1] for word in words).upper()
    product, serial = f"{initials}-1", f"SIM-{initials}-0001"
    imports = sorted([f"from drivers.{name} import {class_of(name)}", "from drivers.modbus import ModbusLink"])
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
        "drivers": "\n".join(imports),
        "imports": bus.imports,
        "serve": bus.serve,
    }
