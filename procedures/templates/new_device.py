"""A package with a device of one's own: it passes the conformance suite of its bus as it stands."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass
from pathlib import Path
from string import Template

from palpate.instrument.additions import additions
from palpate.instrument.bench.kinds import GROUP, KINDS
from palpate.procedures.templates.new_files import check_module, check_name, project_of, template, write_files


@dataclass(frozen=True, slots=True)
class Bus:
    """What differs between the templates of two buses.

    Attributes:
        title: name of the bus.
        form: stem of the file names of its templates.
        suites: test suites that a device on this bus must pass.
        fixture: name of the driver in these tests.
    """

    title: str
    form: str
    suites: str
    fixture: str


BUSES = {
    "modbus-tcp": Bus("Modbus TCP", "modbus", "GoldenFrames, ModbusConformance, OnTheBench", "device"),
    "modbus-rtu": Bus("Modbus RTU", "modbus", "GoldenFrames, OnTheBench, RtuConformance", "device"),
    "canopen": Bus("CANopen", "canopen", "CanopenConformance, CanopenGoldenFrames, OnTheBench", "node"),
}
KINDS_OF_DEVICE = ("actuator", "sensor", "registers")


def new_device(name: str, bus: str, kind: str, folder: Path) -> list[Path]:
    """Write a package with a device into a new folder of that name.

    Its identity holds its whole name, on CANopen as a hash of 64 bits, so that no two packages have the same.

    Args:
        name: name of the module, such as `force_gauge`.
        bus: one of `BUSES`.
        kind: one of `KINDS_OF_DEVICE`.
        folder: where the package's folder goes.

    Returns:
        Its pyproject.toml, module, golden frames and test.

    Raises:
        UsageError: the name cannot be used, or the folder exists; nothing is written.
        RecordError: a file cannot be written.
    """
    check_name("device", name, (*KINDS, *additions(GROUP)))
    check_module(name)
    on, code = BUSES[bus], hashlib.sha256(name.encode()).digest()
    parts = tomllib.loads(template(f"device/{on.form}.toml.txt"))
    vendor, product = code[:4], code[4:8]
    terms = {
        "group": GROUP,
        "entry": project_of(name),
        "object": "KIND",
        "bus": on.title,
        "link": bus,
        "suites": on.suites,
        "fixture": on.fixture,
        "vendor": vendor.hex().upper(),
        "vendor_bytes": vendor[::-1].hex(" ").upper(),
        "product": product.hex().upper() if on.form == "canopen" else project_of(name).upper(),
        "product_bytes": product[::-1].hex(" ").upper(),
    }
    files = {
        "pyproject.toml": template("pyproject.toml.txt"),
        "{}.py": template(f"device/{on.form}.py.txt"),
        "tests/{}.toml": parts["head"] + parts[kind]["golden"],
        "tests/test_{}.py": template("device/test.py.txt"),
    }
    own = {**parts[kind], "imports": "${Class}, Simulated${Class}" if kind == "sensor" else "${Class}"}
    files = {place: Template(text).safe_substitute(own) for place, text in files.items()}
    return write_files("device", name, files, folder, terms)
