"""Packages that begin something of one's own, from templates: they pass their tests as they stand."""

from __future__ import annotations

import hashlib
import importlib.util
import keyword
import os
import re
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template

from palpate.instrument.additions import addition, additions
from palpate.instrument.bench.kinds import GROUP as DEVICES
from palpate.instrument.bench.kinds import KINDS, WHAT, DeviceKind, device_kind
from palpate.instrument.errors import RecordError, UsageError, reason
from palpate.instrument.sensor import designs
from palpate.procedures.engine import catalogue
from palpate.procedures.virtual import explained

NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
LONGEST = 20  # characters of a name
PYTHONS = frozenset({"conftest", "setup", "tests"})  # modules and folders that mean something beside a package


def check_name(kind: str, name: str, taken: Iterable[str] = ()) -> None:
    """Raises UsageError: it is no name of a module, or something else has it, or one of the `taken` names is alike."""
    if keyword.iskeyword(name):
        raise UsageError(f"{name!r} is no name of a {kind}: it is a word of Python; choose another name")
    if not NAME.fullmatch(name) or len(name) > LONGEST:
        raise UsageError(
            f"{name!r} is no name of a {kind}: give small letters, digits and single underscores, at most {LONGEST}"
            " characters, such as force_gauge"
        )
    if name in {each.replace("-", "_") for each in taken}:
        raise UsageError(f"{name!r}: palpate or an installed package has one of that name; choose another name")


def check_module(name: str) -> None:
    """Raises UsageError: a module of that name can be imported already, and one of the two would hide the other."""
    if name in sys.stdlib_module_names or name in PYTHONS or importlib.util.find_spec(name) is not None:
        raise UsageError(f"{name!r}: there is a Python module of that name already; choose another name")


def write_files(kind: str, name: str, files: Mapping[str, str], folder: Path, terms: Mapping[str, str]) -> list[Path]:
    """Write the files of a `kind` of thing into a new folder of that name.

    Args:
        name: name of the folder and of the module, such as `force_gauge`.
        files: where a file goes in the folder, with {} for the name -> its template's text.
        terms: replacements for the placeholders in the templates; those made from the name are added.

    Returns:
        The files, in that order.

    Raises:
        UsageError: the folder exists, or the files use a class for something else that would be called as the thing's
            own; nothing is written.
        RecordError: a file cannot be written.
    """
    tree = folder / name
    if os.path.lexists(tree):
        raise UsageError(f"{tree} exists already; choose another name")
    title, class_name = " ".join(name.split("_")), class_of(name)
    if any(re.search(rf"\b{class_name}\b", Template(text).safe_substitute(terms)) for text in files.values()):
        raise UsageError(f"{name!r}: a class {class_name} is used in its files already; choose another name")
    own = {"kind": kind, "name": name, "project": project_of(name)}
    own |= {"Class": class_name, "title": title, "Title": title.capitalize()}
    for place, text in files.items():
        path = tree / place.format(name)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(Template(text).substitute(terms, **own).rstrip("\n") + "\n", encoding="utf-8")
        except OSError as error:
            raise RecordError(f"{path}: cannot be written: {reason(error)}; give another folder with --to") from None
    return [tree / place.format(name) for place in files]


def write_package(kind: str, name: str, folder: Path, group: str, entry: str, found: str = "${Class}") -> list[Path]:
    """Write a package whose module holds one thing, the object of its entry point, into a new folder of its name.

    Args:
        kind: what the thing is; the folder of its templates.
        name: name of the module, which `check_name` has checked.
        folder: where the package's folder goes.
        group, entry: its entry point.
        found: name of the thing in the module.

    Returns:
        Its pyproject.toml, module and test.

    Raises:
        UsageError: a module or folder of that name exists; nothing is written. RecordError: a file cannot be written.
    """
    check_module(name)
    files = {
        "pyproject.toml": template("pyproject.toml.txt").replace("${object}", found),
        "{}.py": template(f"{kind}/{kind}.py.txt"),
        "tests/test_{}.py": template(f"{kind}/test.py.txt"),
    }
    return write_files(kind, name, files, folder, {"group": group, "entry": entry})


def template(name: str) -> str:
    """The text of a template."""
    return (resources.files("palpate.procedures.templates") / name).read_text(encoding="utf-8")


def class_of(name: str) -> str:
    """The class of a module's name."""
    return "".join(word.capitalize() for word in name.split("_"))


def project_of(name: str) -> str:
    """The distribution of a module's name."""
    return name.replace("_", "-")


# --- A package with a design, a procedure or an effect of one's own ------------------------------------


def new_package(kind: str, name: str, folder: Path) -> list[Path]:
    """Write a package with a "design", a "procedure" or an "effect" into a new folder of that name.

    Scenes and bench files name a design so, and scenes an effect; runs of a procedure have the name with dashes.

    Returns:
        Its pyproject.toml, module and test.

    Raises:
        UsageError: the name cannot be used, or the folder exists; nothing is written.
        RecordError: a file cannot be written.
    """
    if kind == "effect":
        check_name(kind, name, explained.effect_names())
        if any(word[0].isdigit() for word in name.split("_")):  # scenes know it by its class, which has no underscores
            raise UsageError(f"{name!r}: a word of an effect's name begins with a letter; write {_joined(name)!r}")
        return write_package(kind, name, folder, explained.GROUP, name)
    if kind == "procedure":
        check_name(kind, name, (*catalogue.SHIPPED, *additions(catalogue.GROUP)))
        return write_package(kind, name, folder, catalogue.GROUP, project_of(name))
    check_name(kind, name, (*designs.DESIGNS, *additions(designs.GROUP)))
    return write_package(kind, name, folder, designs.GROUP, name, "DESIGN")


def _joined(name: str) -> str:
    """The name with words of digits joined to the ones before them."""
    first, *words = name.split("_")
    return first + "".join(word if word[0].isdigit() else f"_{word}" for word in words)


# --- A package with a device of one's own: it passes the conformance suite of its bus as it stands -----


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
    check_name("device", name, (*KINDS, *additions(DEVICES)))
    check_module(name)
    on, code = BUSES[bus], hashlib.sha256(name.encode()).digest()
    parts = tomllib.loads(template(f"device/{on.form}.toml.txt"))
    vendor, product = code[:4], code[4:8]
    terms = {
        "group": DEVICES,
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


# --- A folder with a bench of one's own: its file, the scene that stands in for it, and tests that run on both

CHANGER = "sample_changer"  # of the usual kinds the one that a bench may lack
FIRST_NUMBER = 10  # of a device on the line or on the bus, behind the usual ones


def new_bench(name: str, kinds: Sequence[str], folder: Path) -> list[Path]:
    """Write a bench with the usual devices and some of other `kinds` into a new folder of that name.

    Raises:
        UsageError: the name cannot be used, the folder exists, or a kind stands there twice or is a usual one; nothing
            is written.
        UnknownName: there is no such kind. ConfigError: the package that adds it cannot be used.
        RecordError: a file cannot be written.
    """
    check_name("bench", name)
    if twice := [kind for number, kind in enumerate(kinds) if kind in kinds[:number]]:
        raise UsageError(f"--device {twice[0]}: give a kind once; copy its section in bench.toml for another one")
    if usual := [kind for kind in kinds if kind in KINDS and kind != CHANGER]:
        raise UsageError(f"--device {usual[0]}: every bench has one; leave it out")
    others = {kind: device_kind(kind) for kind in kinds if kind != CHANGER}
    packages = sorted({entry.package for kind in others if (entry := addition(DEVICES, WHAT, kind))} - {""})
    simulated = [kind for kind in others.values() if kind.simulator is not None]
    every = [*(kind for kind in KINDS if kind != CHANGER or kind in kinds), *others]
    absent = [kind for kind in every if kind == CHANGER or (kind in others and others[kind] not in simulated)]
    listed = [*([KINDS[CHANGER]] if CHANGER in kinds else []), *others.values()]
    terms = {
        "bench": "".join(_section(kind, number) for number, kind in enumerate(listed)),
        "scene": "".join(f'\n[device.{_called(kind)}]\nkind = "{kind.name}"\n' for kind in simulated),
        "kinds": ", ".join(f'"{kind}"' for kind in every),
        "absent": _absent(absent) if absent else "",
        "packages": "".join(f" and {package}" for package in packages),
    }
    files = {
        "bench.toml": template("bench/bench.toml.txt"),
        "scene.toml": template("bench/scene.toml.txt"),
        "conftest.py": template("bench/conftest.py.txt"),
        "pytest.toml": template("bench/pytest.toml.txt"),
        "README.md": template("bench/README.md.txt"),
        "tests/test_bench.py": template("bench/test_bench.py.txt"),
    }
    return write_files("bench", name, files, folder, terms)


def _section(kind: DeviceKind, number: int) -> str:
    """The section of a bench file for a device. A device on TCP also gets a link of its own."""
    name, link = _called(kind), kind.links[0]
    if link == "modbus-tcp":
        place = f'link = "{name}"\nunit = 1\n'
        own = f'\n[link.{name}]\nkind = "{link}"\nhost = "192.168.1.{30 + number}"\n'
    else:
        key, shared = ("unit", "line") if link == "modbus-rtu" else ("node", "can")
        place, own = f'link = "{shared}"\n{key} = {FIRST_NUMBER + number}\n', ""
    return f'{own}\n[device.{name}]\nkind = "{kind.name}"\n{place}'


def _absent(kinds: Sequence[str]) -> str:
    """What a test takes away from the kinds of the bench file to get those of the simulated bench."""
    named = ", ".join(f'"{kind}"' for kind in kinds)
    return f" - {{{named}}}  # nothing stands in for what is taken away"


def _called(kind: DeviceKind) -> str:
    """A device by its kind."""
    return kind.name.replace("-", "_")
