"""The documentation is true of the code."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator
from dataclasses import fields
from itertools import takewhile
from pathlib import Path

import click
import pytest

from palpate.drivers.devices.load_indicator import Following
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.bench.role_maps import LoadIndicatorMap, LowPass
from palpate.instrument.contracts.maps.golden_frames import prove
from palpate.instrument.contracts.maps.map_file import shipped as maps
from palpate.procedures.commands.root import palpate as main
from palpate.procedures.engine.catalogue import SHIPPED, procedure_class
from palpate.procedures.records.columns import columns_of
from palpate.procedures.steps.policy import POLICIES
from palpate.simulators.faults import FAULTS, fault_class
from tests.procedures.conftest import Palpate

DOCUMENTATION = Path(__file__).parents[2] / "docs"


def table(page: str) -> list[tuple[str, ...]]:
    """The first table of a page, without its head."""
    section, _, _ = (DOCUMENTATION / page).read_text(encoding="utf-8").partition("\n## ")
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [tuple(cell.strip() for cell in line.strip("|").split("|")) for line in lines[2:]]


def test_the_table_of_incidents_is_that_of_the_policies() -> None:
    assert table("explanation/incidents.md") == [(p.incident, p.does, str(p.attempts)) for p in POLICIES]


def test_every_fault_says_what_it_does() -> None:
    assert [name for name in FAULTS if not fault_class(name).__doc__] == []


def test_the_table_of_extras_has_each_once() -> None:
    pyproject = tomllib.loads((DOCUMENTATION.parent / "pyproject.toml").read_text(encoding="utf-8"))
    assert sorted(row[0].strip("`") for row in table("how-to/install.md")) == sorted(
        pyproject["project"]["optional-dependencies"]
    )


def commands(group: click.Group, path: str = "palpate") -> Iterator[str]:
    for name, command in group.commands.items():
        if not isinstance(command, click.Group) or command.invoke_without_command or not command.commands:
            yield f"{path} {name}"
        if isinstance(command, click.Group):
            yield from commands(command, f"{path} {name}")


def named(cell: str) -> Iterator[str]:
    """Commands in a cell such as "`palpate runs list`, `show RUN`"."""
    group: list[str] = []
    for text in re.findall("`([^`]*)`", cell):
        words = list(takewhile(re.compile("[a-z][a-z-]*").fullmatch, text.split()))
        words = words if words[0] == "palpate" else [*group, *words]
        group = words[:-1]
        yield " ".join(words)


def test_the_table_of_commands_has_each_once() -> None:
    assert sorted(name for cell, _ in table("reference/commands.md") for name in named(cell)) == sorted(commands(main))


@pytest.mark.parametrize(
    ("command", "row"),
    [
        ("model surfaces", "model surfaces"),
        ("scene list", "scene list"),
        ("scene check ideal", "scene check"),
        ("scene explain ideal", "scene explain"),
        ("runs list", "runs list"),
        ("contracts export --to maps", "`runs export`, `contracts export`, `new`"),
        ("model ratio --model column --sensed-modulus 100kPa", "model ratio"),
    ],
)
def test_the_names_in_json_are_those_of_the_command(palpate: Palpate, command: str, row: str) -> None:
    (names,) = (cell for commands, cell in table("reference/json.md") if commands.strip("`") == row.strip("`"))
    outside = re.sub(r"\([^()]*\)", "", re.sub(r"\([^()]*\)", "", names))
    assert re.findall("`([^`]*)`", outside) == list(palpate(*command.split(), "--json").object)


def test_each_field_of_a_point_says_what_it_is() -> None:
    for name in sorted(SHIPPED):
        point = procedure_class(name).point
        told = columns_of(point)
        assert [field.name for field in fields(point) if field.name not in told or not told[field.name].doc] == []


def test_the_table_of_instruments_has_each_map() -> None:
    rows = []
    for kind in map(device_kind, maps()):
        title = (DOCUMENTATION / "devices" / f"{kind.name}.md").read_text(encoding="utf-8").partition("\n")[0]
        roles = ", ".join(kind.roles).replace("_", " ")
        assert kind.map is not None
        proof = prove(kind.contract, kind.map.frames)
        assert proof.without == ()
        printed = f"{list(proof.proved.values()).count('printed')} of {len(kind.contract.fields)}"
        cells = (f"`{kind.name}`", roles, ", ".join(kind.links), kind.contract.known_by, printed)
        rows.append((f"[{title.removeprefix('# ')}]({kind.name}.md)", *cells))
    assert sorted(table("devices/index.md")) == sorted(rows)


def test_the_page_of_the_tlb4_says_up_to_which_frequency_its_fastest_filter_follows() -> None:
    page = (DOCUMENTATION / "devices" / "laumas-tlb4.md").read_text(encoding="utf-8")
    corner, rate = (float(found) for found in re.findall(r'= "(\d+) Hz"`', page))
    highest = Following(LowPass(corner=corner), rate, polled=True).highest()
    assert f"follows loads up to {math.floor(10 * highest) / 10:g} Hz" in page


def test_the_page_of_the_dad_141_says_what_its_readings_lose() -> None:
    role = device_kind("flintec-dad-141").serves["load_indicator"]
    assert isinstance(role, LoadIndicatorMap) and role.filter is not None
    off, usual = (Following(role.filter.levels[level], role.rate) for level in ("0", "3"))
    page = (DOCUMENTATION / "devices" / "flintec-dad-141.md").read_text(encoding="utf-8")
    assert f"It follows loads up to {math.floor(10 * off.highest()) / 10:g} Hz" in page
    assert f"At 10 Hz up to {off.loss(10.0):.1%} are lost".replace("%", " %") in page
    assert f"{usual.loss(10.0):.0%} of a force at 10 Hz are lost".replace("%", " %") in page
