"""A field of a point is said once, by its column; and what is printed for people fits their terminal."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

import palpate
from palpate import as_dataset, read
from palpate.extend import gathered
from palpate.instrument.quantity import counted
from palpate.procedures.engine.catalogue import SHIPPED
from palpate.procedures.showing import text
from palpate.procedures.showing.text import new_table, number, percent, print_all, stamped
from tests.conftest import Install
from tests.procedures.conftest import Palpate

PROCEDURE = """
from dataclasses import dataclass
from typing import Annotated

from palpate import get_sample
from palpate.extend import Column, DynamicLoadWork, Measurement, Plan, Procedure, SimpleResult, Step, gathered


@dataclass(frozen=True)
class WaitPoint:
    sample: str
    force_ratio: Annotated[float, Column("force ratio of the sensor", head="ratio", cell="z.4f")]
    settling_s: Annotated[float, Column("how long the films took", "s", "settled\\nms", "z.0f", 1e3, u="settling_u")]
    settling_u: float = 0.1


@dataclass(frozen=True, slots=True)
class WaitStep(Step):
    sample: str


@dataclass(frozen=True)
class Waiting(Procedure):
    name, point = "waiting", WaitPoint

    def plan(self, target):
        return Plan(self.name, [WaitStep(1.0, 5.0, None, "1", what="load set 1", group="mount")])

    def begin(self, plan, lab, record):
        return Work(lab, record, (2.0,), 10.0, ("1",))

    def evaluate(self, points, plan, lab):
        return SimpleResult(points)


class Work(DynamicLoadWork):
    def arrange(self, step):
        self.press(get_sample(step.sample))

    def take(self, step):
        measured = self.measured(2.0, step.what, 1.0)
        return Measurement(gathered(WaitPoint, step, measured, measured.forces(self.lab.design)))
"""


def installed(install: Install, old: str = "", new: str = "") -> None:
    module = {"acme_waiting": PROCEDURE.replace(old, new)}
    install("acme-lab", "palpate.procedures", {"waiting": "acme_waiting:Waiting"}, **module)


def test_a_new_column_of_a_sweep_is_one_place_is_recorded_and_a_dataset_says_what_it_is(
    install: Install, palpate: Palpate
) -> None:
    installed(install)
    lines = palpate("measure", "waiting", "--scene", "ideal", "--out", "printed").out.splitlines()
    heads, units, _, row = (line.split() for line in lines[2:6])
    assert (heads, units) == (["settled"], ["ratio", "ms"])
    (point,) = palpate("measure", "waiting", "--scene", "ideal", "--out", "told", "--json").object["points"]
    assert (row, list(point)) == (
        [f"{point['force_ratio']:.4f}", f"{1e3 * point['settling_s']:.0f}"],
        ["sample", "force_ratio", "settling_s", "settling_u"],
    )
    run = read(Path("told"))
    (recorded,) = run.points()
    assert {name: recorded[name] for name in point} == point
    settling = as_dataset(run).settling_s
    about = {"units": "s", "long_name": "how long the films took", "ancillary_variables": "settling_u"}
    assert (settling.attrs, settling.values.tolist()) == (about, [point["settling_s"]])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('u="settling_u"', 'u="settled_u"', "WaitPoint.settling_s: u 'settled_u' is no field of it; name one"),
        ('head="ratio"', 'after="load_N"', "WaitPoint.force_ratio: after 'load_N' is no field of it; name one"),
        ("sample: str\n    force", 'sample: "Text"\n    force', "WaitPoint: name 'Text' is not defined; import it"),
        ("[float, Column", "[float, Column(), Column", "WaitPoint.force_ratio has 2 columns; give it one"),
        ("@dataclass(frozen=True)\nclass WaitPoint", "class WaitPoint", "is no dataclass, and so it has no columns"),
    ],
)
def test_a_column_that_cannot_be_is_refused_before_anything_is_sent(
    install: Install, palpate: Palpate, old: str, new: str, said: str
) -> None:
    installed(install, old, new)
    found = palpate("measure", "waiting", "--scene", "ideal", "--out", "run")
    assert (found.status, said in found.complaint) == (2, True)
    assert not Path("run").exists()


def test_a_value_that_its_format_cannot_print_is_told_with_its_field(install: Install, palpate: Palpate) -> None:
    installed(install, '"z.4f"', '"d"')
    said = palpate("measure", "waiting", "--scene", "ideal", "--out", "run").complaint
    assert "WaitPoint.force_ratio: 0.3" in said and "cannot be printed as 'd'" in said


@dataclass(frozen=True)
class Point:
    load_N: float
    dwell_s: float = 1.0


LOAD, DWELL = SimpleNamespace(load_N=2.0), SimpleNamespace(dwell_s=3.0)


def test_a_point_is_gathered_from_what_has_its_names() -> None:
    assert (gathered(Point, LOAD), gathered(Point, LOAD, DWELL)) == (Point(2.0, 1.0), Point(2.0, 3.0))
    assert gathered(Point, LOAD, LOAD, load_N=4.0) == Point(4.0, 1.0)


@pytest.mark.parametrize(
    ("sources", "given", "message"),
    [
        ((LOAD, LOAD), {}, r"^Point.load_N: .* and .* both have it; say which is meant: load_N="),
        ((DWELL,), {}, r"^Point.load_N: it is in none of its sources \(SimpleNamespace\)"),
        ((LOAD,), {"load": 3.0}, r"^Point.load: there is no such field; leave load=... out"),
    ],
)
def test_what_is_not_sure_is_not_gathered(
    sources: tuple[SimpleNamespace, ...], given: dict[str, float], message: str
) -> None:
    with pytest.raises(palpate.ConfigError, match=message):
        gathered(Point, *sources, **given)


# --- What is printed for people: blocks of columns in a narrow terminal, the singular for one,  -------

SHOWING = Path(text.__file__).parent
COLUMNS = ("id", *(f"quantity_{n}" for n in range(20)))


@pytest.mark.parametrize("width", [20, 40, 80, 400])
def test_a_table_too_wide_for_the_terminal_is_printed_in_blocks_that_repeat_its_first_column(
    width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(text, "console", lambda: Console(width=width, force_terminal=True, color_system=None))
    table = new_table(stamped(False, "T"), *COLUMNS)
    for row in range(2):
        table.add_row(str(row), *(f"{row}.{n}" for n in range(20)))
    print_all(table)
    lines = [line for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert all(len(line.rstrip()) <= width for line in lines)
    heads = [line.split() for line in lines if "quantity_" in line]
    assert (len(heads), [name for head in heads for name in head if name != "id"]) == (
        {20: 20, 40: 10, 80: 4, 400: 1}[width],
        list(COLUMNS[1:]),
    )
    assert {head[0] for head in heads} == {"id"}
    cells = [line.split()[1:] for line in lines if line.split()[0] == "1"]
    assert ([cell for some in cells for cell in some], lines[0].strip()) == ([f"1.{n}" for n in range(20)], "T")


def test_a_terminal_gets_no_line_wider_than_itself_but_one_that_a_single_word_makes_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(text, "console", lambda: Console(width=40, force_terminal=True, color_system=None))
    path = "/" + 5 * "a-folder/" + "plot.png"
    words = "the scatter of mountings was never measured and counts as none"
    print_all(f"note           {words}", words, f"  best now  {words}\nplot           {path}")
    assert capsys.readouterr().out.splitlines() == [
        "note           the scatter of mountings",
        "               was never measured and",
        "               counts as none",
        "the scatter of mountings was never",
        "measured and counts as none",
        "  best now  the scatter of mountings was",
        "            never measured and counts as",
        "            none",
        f"plot           {path}",
    ]


def test_where_the_output_is_no_terminal_a_line_stays_whole(capsys: pytest.CaptureFixture[str]) -> None:
    line = "note           " + 40 * "word "
    print_all(line)
    assert capsys.readouterr().out == f"{line}\n"


def test_one_is_singular() -> None:
    assert [counted(n, "point") for n in range(3)] == ["0 points", "1 point", "2 points"]


def test_no_table_has_a_negative_zero() -> None:
    assert (percent(-1e-6), number(-0.0)) == ("0.00", "0")
    measurements = SHOWING.parent / "measurements"
    shown = [
        file.read_text(encoding="utf-8").partition("# --- what it shows")[2] for file in measurements.rglob("*.py")
    ]
    texts = [*(file.read_text(encoding="utf-8") for file in SHOWING.glob("*.py")), *filter(None, shown)]
    fixed = [found for text in texts for found in re.findall(r":\+?\.\df\}", text)]
    columns = [file.read_text(encoding="utf-8") for file in measurements.rglob("*.py")]
    fixed += [found for text in columns for found in re.findall(r"\"\+?\.\df\"", text)]
    assert sum(map(bool, shown)) == len(SHIPPED)
    assert fixed == []  # a z after the colon or quote, or the sign, makes -0.0 into 0.0
