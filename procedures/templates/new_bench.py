"""A folder with a bench of one's own: its file, the scene that stands in for it, and tests that run on both."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from palpate.instrument.additions import addition
from palpate.instrument.bench.kinds import GROUP, KINDS, WHAT, DeviceKind, device_kind
from palpate.instrument.errors import UsageError
from palpate.procedures.templates.new_files import check_name, template, write_files

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
    packages = sorted({entry.package for kind in others if (entry := addition(GROUP, WHAT, kind))} - {""})
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
