"""The files of a new device, in the style of the others: they pass its conformance suite as they stand."""

from __future__ import annotations

import keyword
import re
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template

from instrument.errors import RecordError, UsageError

NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
LONGEST = 20  # characters of a name
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
    if not NAME.fullmatch(name) or len(name) > LONGEST or keyword.iskeyword(name):
        raise UsageError(
            f"{name!r} is no name of a device: give small letters, digits and single underscores, at most {LONGEST}"
            " characters, such as force_gauge"
        )
    paths = {template: tree / place.format(name) for template, place in FILES.items()}
    for path in paths.values():
        if not path.parent.is_dir():
            raise UsageError(f"{tree} is no source tree of palpate, it has no {path.parent}; give one with --to")
        if path.exists():
            raise UsageError(f"{path} exists already; choose another name")
    terms, folder = _terms(name, BUSES[bus]), resources.files("procedures") / "templates"
    texts = {template: (folder / template).read_text(encoding="utf-8") for template in FILES}
    if any(re.search(rf"\b{terms['Class']}\b", text) for text in (*texts.values(), str(BUSES[bus]))):
        raise UsageError(f"{name!r}: a class {terms['Class']} is used in its files already; choose another name")
    for template, path in paths.items():
        try:
            path.write_text(Template(texts[template]).substitute(terms), encoding="utf-8")
        except OSError as error:
            raise RecordError(f"{path}: cannot be written: {error.strerror}; make it writable") from None
    return list(paths.values())


def _terms(name: str, bus: Bus) -> dict[str, str]:
    words = name.split("_")
    title = " ".join(words)
    initials = "".join(word[0] for word in words).upper()
    product, serial = f"{initials}-1", f"SIM-{initials}-0001"
    class_name = "".join(word.capitalize() for word in words)
    imports = sorted([f"from drivers.{name} import {class_name}", "from drivers.modbus import ModbusLink"])
    identity = {0: "Palpate", 1: product, 2: "1.0", 4: title, 6: "simulated", 0x80: serial}
    return {
        "name": name,
        "Class": class_name,
        "title": title,
        "Title": title.capitalize(),
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
