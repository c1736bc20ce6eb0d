"""docs/thesis.md: what Palpate has of the thesis, and what not, is all there, and what it names exists."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import click

from palpate.instrument.bench.kinds import KINDS
from palpate.instrument.sensor.designs import DESIGNS
from palpate.instrument.thesis import contents
from palpate.procedures.commands.root import palpate as command
from palpate.procedures.measurements.characterise.report import DEFINITIONS, ELSEWHERE
from palpate.simulators.effects import EFFECTS

ROOT = Path(__file__).parents[2]
DOCUMENT = (ROOT / "docs" / "thesis.md").read_text(encoding="utf-8")


def commands(group: click.Group, above: str = "") -> Iterator[str]:
    context = click.Context(group)
    for name in group.list_commands(context):
        yield f"{above}{name}"
        found = group.get_command(context, name)
        if isinstance(found, click.Group):
            yield from commands(found, f"{above}{name} ")


def test_what_the_document_names_exists() -> None:
    scenes = {path.stem for path in (ROOT / "simulators" / "scenes").glob("*.toml")}
    known = {
        *EFFECTS,
        *DESIGNS,
        *scenes,
        *KINDS,
        *commands(command),
        *DEFINITIONS,
        "palpate reproduce",
        "pickup",
        "--budget",
    }
    named = set(re.findall(r"`([^`]+)`", DOCUMENT))
    assert {name for name in named - known if not (ROOT / name).is_file()} == set()


def test_every_property_of_a_sensor_has_its_line_under_the_section_that_it_names() -> None:
    theses = [*(each.thesis for each in DEFINITIONS.values()), *(each["thesis"] for each in ELSEWHERE)]
    sections = {each.split()[0].rstrip(",") for each in theses}
    lines = [line.split("|") for line in DOCUMENT.splitlines() if line.startswith("| 2.1")]
    assert sections == set(re.findall(r"2\.1[.\d]*", " ".join(line[1] for line in lines)))
    for quantity, definition in DEFINITIONS.items():
        section = definition.thesis.split()[0].rstrip(",")
        assert any(section in line[1] and f"`{quantity}`" in line[3] for line in lines), quantity
    for each in ELSEWHERE:
        assert any(
            each["thesis"] in line[1] and f"`{each['command'].removeprefix('palpate ')}`" in line[3] for line in lines
        )


def test_the_files_that_a_part_is_exist() -> None:
    for content in contents().values():
        folder = ROOT
        for name in re.findall(r"[\w/]+\.py", content.part):
            folder = (ROOT / name).parent if "/" in name else folder
            assert (folder / Path(name).name).is_file(), content


def test_the_readme_links_the_document() -> None:
    assert "(docs/thesis.md)" in (ROOT / "README.md").read_text(encoding="utf-8")
