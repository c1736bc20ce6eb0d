"""The documentation, its decisions and its page on the thesis are true of the code."""

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
from palpate.instrument.bench.kinds import KINDS, device_kind
from palpate.instrument.bench.role_maps import LoadIndicatorMap, LowPass
from palpate.instrument.contracts.maps.golden_frames import prove
from palpate.instrument.contracts.maps.map_file import shipped as maps
from palpate.instrument.sensor.designs import DESIGNS
from palpate.instrument.thesis import contents
from palpate.procedures.engine.catalogue import SHIPPED, procedure_class
from palpate.procedures.measurements.characterise.report import DEFINITIONS, ELSEWHERE
from palpate.procedures.records.columns import columns_of
from palpate.procedures.steps.policy import POLICIES
from palpate.simulators.effects import EFFECTS
from palpate.simulators.faults import FAULTS, fault_class
from tests.procedures.conftest import Palpate, commands

DOCUMENTATION = Path(__file__).parents[2] / "docs"


def table(page: str) -> list[tuple[str, ...]]:
    """The first table of a page, without its head."""
    section, _, _ = (DOCUMENTATION / page).read_text(encoding="utf-8").partition("\n## ")
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [tuple(cell.strip() for cell in line.strip("|").split("|")) for line in lines[2:]]


def test_the_table_of_incidents_is_that_of_the_policies() -> None:
    assert table("explanation/incidents.md") == [(p.incident, p.does, str(p.attempts)) for p in POLICIES]


def test_the_table_of_extras_has_each_once() -> None:
    pyproject = tomllib.loads((DOCUMENTATION.parent / "pyproject.toml").read_text(encoding="utf-8"))
    assert sorted(row[0].strip("`") for row in table("how-to/install.md")) == sorted(
        pyproject["project"]["optional-dependencies"]
    )


def named(cell: str) -> Iterator[str]:
    """Commands in a cell such as "`palpate runs list`, `show RUN`"."""
    group: list[str] = []
    for text in re.findall("`([^`]*)`", cell):
        words = list(takewhile(re.compile("[a-z][a-z-]*").fullmatch, text.split()))
        words = words if words[0] == "palpate" else [*group, *words]
        group = words[:-1]
        yield " ".join(words)


def runs(command: click.Command) -> bool:
    """Whether it is no group that does nothing without one of its commands."""
    return not (isinstance(command, click.Group) and command.commands) or command.invoke_without_command


def test_the_table_of_commands_has_each_once() -> None:
    runnable = [" ".join(("palpate", *path)) for path, command in commands() if runs(command)]
    assert sorted(name for cell, _ in table("reference/commands.md") for name in named(cell)) == sorted(runnable)


@pytest.mark.parametrize(
    ("command", "row"),
    [
        ("model surfaces", "model surfaces"),
        ("scene list", "scene list"),
        ("scene check ideal", "scene check"),
        pytest.param("scene explain ideal", "scene explain", marks=pytest.mark.slow),
        ("runs list", "runs list"),
        ("contracts export --to maps", "`runs export`, `contracts export`, `new`"),
        ("model ratio --model column --sensed-modulus 100kPa", "model ratio"),
    ],
)
def test_the_names_in_json_are_those_of_the_command(palpate: Palpate, command: str, row: str) -> None:
    (names,) = (cell for commands, cell in table("reference/json.md") if commands.strip("`") == row.strip("`"))
    outside = re.sub(r"\([^()]*\)", "", re.sub(r"\([^()]*\)", "", names))
    assert re.findall("`([^`]*)`", outside) == list(palpate(*command.split(), "--json").object)


def test_each_fault_and_each_field_of_a_point_says_what_it_is() -> None:
    points = [(procedure_class(name).point, columns_of(procedure_class(name).point)) for name in sorted(SHIPPED)]
    silent = [
        field.name
        for point, told in points
        for field in fields(point)
        if field.name not in told or not told[field.name].doc
    ]
    assert silent + [name for name in FAULTS if not fault_class(name).__doc__] == []


def test_the_table_of_instruments_has_each_map() -> None:
    rows = []
    for kind in map(device_kind, maps()):
        title = (DOCUMENTATION / "devices" / f"{kind.name}.md").read_text(encoding="utf-8").partition("\n")[0]
        assert kind.map is not None
        proof = prove(kind.contract, kind.map.frames)
        printed = f"{list(proof.proved.values()).count('printed')} of {len(kind.contract.fields)}"
        cells = (
            f"`{kind.name}`",
            ", ".join(kind.roles).replace("_", " "),
            ", ".join(kind.links),
            kind.contract.known_by,
        )
        rows.append((f"[{title.removeprefix('# ')}]({kind.name}.md)", *cells, printed))
        assert proof.without == ()
    assert sorted(table("devices/index.md")) == sorted(rows)


def test_the_pages_of_indicators_say_up_to_which_frequency_they_follow_and_what_their_readings_lose() -> None:
    pages = {
        name: (DOCUMENTATION / "devices" / f"{name}.md").read_text() for name in ("laumas-tlb4", "flintec-dad-141")
    }
    corner, rate = (float(found) for found in re.findall(r'= "(\d+) Hz"`', pages["laumas-tlb4"]))
    fastest = Following(LowPass(corner=corner), rate, polled=True)
    role = device_kind("flintec-dad-141").serves["load_indicator"]
    assert isinstance(role, LoadIndicatorMap) and role.filter is not None
    off, usual = (Following(role.filter.levels[level], role.rate) for level in ("0", "3"))
    assert f"follows loads up to {math.floor(10 * fastest.highest()) / 10:g} Hz" in pages["laumas-tlb4"]
    for text in (
        f"It follows loads up to {math.floor(10 * off.highest()) / 10:g} Hz",
        f"At 10 Hz up to {off.loss(10.0):.1%} are lost".replace("%", " %"),
        f"{usual.loss(10.0):.0%} of a force at 10 Hz are lost".replace("%", " %"),
    ):
        assert text in pages["flintec-dad-141"]


# --- docs/decisions -----------------------------------------------------------------------------------

FOLDER = DOCUMENTATION.parent / "docs" / "decisions"
PAGES = sorted(page for page in FOLDER.glob("*.md") if page.name != "index.md")
RECORD = re.compile(r"^## (\d{4}) (.+)\n\n((?:.|\n)*?)(?=^## |\Z)", re.MULTILINE)
LONGEST = 150  # words


def records() -> list[tuple[str, str, str, str]]:
    """Page, number, title and text of each."""
    return [(page.name, *found) for page in PAGES for found in RECORD.findall(page.read_text(encoding="utf-8"))]


def test_every_heading_is_a_short_record_with_a_number_of_its_own() -> None:
    texts = {number: text for _, number, _, text in records()}
    assert len(texts) == len(records()) == sum(page.read_text(encoding="utf-8").count("\n## ") for page in PAGES)
    assert {number for number, text in texts.items() if len(text.split()) > LONGEST} == set()


def test_the_index_leads_to_every_page() -> None:
    linked = re.findall(r"\]\((\w+\.md)\)", (FOLDER / "index.md").read_text(encoding="utf-8"))
    assert sorted(linked) == [page.name for page in PAGES]


def test_what_a_record_names_exists() -> None:
    numbers = {number for _, number, _, _ in records()}
    for _, number, _, text in records():
        assert set(re.findall(r"(?<![\d.,])0\d{3}(?![\d.,]\d|\d)", text)) <= numbers, number
        paths = re.findall(r"`([\w.]+/[\w./]+\.\w+)`", text)
        assert [path for path in paths if not (DOCUMENTATION.parent / path).exists()] == [], number


def test_a_record_that_another_page_links_to_is_in_force() -> None:
    anchors = {
        f"{page}#" + re.sub(r"[^\w\- ]", "", f"{number} {title}".lower()).replace(" ", "-")
        for page, number, title, _ in records()
    }
    for page in [DOCUMENTATION.parent / "README.md", *(DOCUMENTATION.parent / "docs").rglob("*.md")]:
        linked = re.findall(r"decisions/(\w+\.md#[^)]+)\)", page.read_text(encoding="utf-8"))
        assert set(linked) <= anchors, page


# --- docs/thesis.md ------------------------------------------------------------------------------------

THESIS = (DOCUMENTATION.parent / "docs" / "thesis.md").read_text(encoding="utf-8")


def test_what_the_document_names_exists() -> None:
    scenes = {path.stem for path in (DOCUMENTATION.parent / "simulators" / "scenes").glob("*.toml")}
    known = {
        *EFFECTS,
        *DESIGNS,
        *scenes,
        *KINDS,
        *(" ".join(path) for path, _ in commands()),
        *DEFINITIONS,
        "palpate reproduce",
        "pickup",
        "--budget",
    }
    named = set(re.findall(r"`([^`]+)`", THESIS))
    assert {name for name in named - known if not (DOCUMENTATION.parent / name).is_file()} == set()


def test_every_property_of_a_sensor_has_its_line_under_the_section_that_it_names() -> None:
    theses = [*(each.thesis for each in DEFINITIONS.values()), *(each["thesis"] for each in ELSEWHERE)]
    sections = {each.split()[0].rstrip(",") for each in theses}
    lines = [line.split("|") for line in THESIS.splitlines() if line.startswith("| 2.1")]
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
        folder = DOCUMENTATION.parent
        for name in re.findall(r"[\w/]+\.py", content.part):
            folder = (DOCUMENTATION.parent / name).parent if "/" in name else folder
            assert (folder / Path(name).name).is_file(), content
