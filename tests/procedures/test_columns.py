"""A field of a point is said once: it is gathered by its name, recorded, printed and described by its column."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

import palpate
from palpate import as_dataset, read
from palpate.extend import gathered
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


def test_a_new_column_of_a_sweep_is_one_place(install: Install, palpate: Palpate) -> None:
    installed(install)
    lines = palpate("measure", "waiting", "--scene", "ideal", "--out", "printed").out.splitlines()
    heads, units, _, row = (line.split() for line in lines[2:6])
    assert (heads, units) == (["settled"], ["ratio", "ms"])
    (point,) = palpate("measure", "waiting", "--scene", "ideal", "--out", "told", "--json").object["points"]
    assert row == [f"{point['force_ratio']:.4f}", f"{1e3 * point['settling_s']:.0f}"]
    assert list(point) == ["sample", "force_ratio", "settling_s", "settling_u"]


def test_it_is_recorded_and_a_dataset_says_what_it_is(install: Install, palpate: Palpate) -> None:
    installed(install)
    (point,) = palpate("measure", "waiting", "--scene", "ideal", "--out", "run", "--json").object["points"]
    run = read(Path("run"))
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
    assert "WaitPoint.force_ratio: 0.3" in said
    assert "cannot be printed as 'd'" in said


@dataclass(frozen=True)
class Point:
    load_N: float
    dwell_s: float = 1.0


LOAD, DWELL = SimpleNamespace(load_N=2.0), SimpleNamespace(dwell_s=3.0)


def test_a_point_is_gathered_from_what_has_its_names() -> None:
    assert gathered(Point, LOAD) == Point(2.0, 1.0)
    assert gathered(Point, LOAD, DWELL) == Point(2.0, 3.0)
    assert gathered(Point, LOAD, LOAD, load_N=4.0) == Point(4.0, 1.0)


def test_what_is_not_sure_is_not_gathered() -> None:
    with pytest.raises(
        palpate.ConfigError, match=r"^Point.load_N: .* and .* both have it; say which is meant: load_N="
    ):
        gathered(Point, LOAD, LOAD)
    with pytest.raises(palpate.ConfigError, match=r"^Point.load_N: it is in none of its sources \(SimpleNamespace\)"):
        gathered(Point, DWELL)
    with pytest.raises(palpate.ConfigError, match=r"^Point.load: there is no such field; leave load=... out"):
        gathered(Point, LOAD, load=3.0)
