"""What a procedure of another package returns is checked: nonsense is named, and changes nothing that palpate says."""

from __future__ import annotations

import math
import threading
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate
from palpate.extend import Lab, Measurement, Plan, Procedure, SimpleResult, Step, Target
from palpate.instrument.errors import ConfigError, RangeError
from palpate.procedures.commands.options import Output
from palpate.procedures.engine.conduct import asked, conduct
from palpate.procedures.lab.session import reserved
from palpate.procedures.records.record import Recorder
from tests.procedures.conftest import HEADER


@dataclass(frozen=True)
class Point:
    x: float


@dataclass(frozen=True)
class Other:
    x: float


class Nonsense(Procedure[Any, Any, Any]):
    """Each of its methods returns what it is given."""

    name, point = "nonsense", Point

    def __init__(self, **returned: Any) -> None:
        object.__setattr__(self, "returned", returned)

    def plan(self, target: Target) -> Any:
        return self._get("plan", Plan("nonsense", [Step(None, 1.0, None)]))

    def begin(self, plan: Any, lab: Lab, record: Recorder) -> Any:
        return self._get("begin", self)

    def arrange(self, step: Step) -> None: ...

    def take(self, step: Step) -> Any:
        return self._get("take", Measurement(Point(1.0)))

    def end(self) -> None: ...

    def course(self, plan: Any, points: Any, lab: Lab) -> Any:
        return self._get("course", super().course(plan, points, lab))

    def model_question(self, design: Any) -> Any:
        return self._get("model_question", None)

    def evaluate(self, points: Any, plan: Any, lab: Lab) -> Any:
        return self._get("evaluate", SimpleResult(points))

    def _get(self, name: str, usual: object) -> Any:
        returned: dict[str, object] = vars(self)["returned"]
        return returned.get(name, usual)


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    with palpate.open_bench(scene="ideal") as bench:
        yield bench.lab("nonsense", bench.started)


def _yields(*numbers: Any, ends: Any = "") -> Generator[Any, Any, Any]:
    yield from numbers
    return ends


LATE = (Step(None, 1.0, None) for _ in range(2))


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        ({"plan": None}, "plan returned None; it must return a Plan"),
        ({"plan": Plan("nonsense", [1])}, "plan returned 1 as a step; it must be a Step"),  # type: ignore[list-item]
        ({"plan": Plan("nonsense", LATE)}, "plan returned steps <generator.*; they must be a list"),  # type: ignore[arg-type]
        ({"begin": None}, "begin returned None; it must return the work, with arrange, take and end"),
        ({"course": None}, "course returned None; it must yield numbers of steps"),
        ({"course": _yields(1)}, "course yielded 1 after step -1; it must be the number of a later step, below 1"),
        ({"course": _yields(None)}, "course yielded None after step -1"),
        ({"course": _yields(ends=None)}, "course ended with None; it must return a text"),
        ({"take": None}, "take returned None; it must return a Measurement"),
        ({"take": Measurement(Other(1.0))}, r"take returned the point .*Other\(x=1.0\); it must be a Point"),
        ({"take": Measurement({"x": 1})}, r"take returned the point {'x': 1}; it must be a Point"),  # type: ignore[type-var]
        ({"evaluate": None}, "evaluate returned None; it must return a result, as SimpleResult is"),
    ],
)
def test_what_a_procedure_must_not_return_is_named(
    lab: Lab, tmp_path: Path, returned: dict[str, object], message: str
) -> None:
    with Recorder.create(tmp_path, HEADER) as record, pytest.raises(ConfigError, match=message):
        conduct(Nonsense(**returned), lab, record)
    assert record.points == (1 if "evaluate" in returned else 0)


def test_what_a_procedure_asks_a_model_is_a_question(lab: Lab) -> None:
    assert asked(Nonsense(), lab.design) is None
    with pytest.raises(ConfigError, match="model_question returned 'surface'; it must return a Question or None"):
        asked(Nonsense(model_question="surface"), lab.design)


@pytest.mark.parametrize("name", ["simulated", "run", "seed", "mounting", "points", "plot", "bench_seconds"])
def test_a_finding_cannot_stand_in_for_what_palpate_says_of_the_run(lab: Lab, tmp_path: Path, name: str) -> None:
    found = SimpleResult([], {name: False})
    assert name in reserved()
    with (
        Recorder.create(tmp_path, HEADER) as record,
        pytest.raises(ConfigError, match=f"'nonsense': its result has a value '{name}', which palpate gives"),
    ):
        conduct(Nonsense(evaluate=found), lab, record)


@pytest.mark.parametrize(
    ("value", "named"),
    [
        ({1, 2}, "of type set"),
        (object(), "of type object"),
        (1j, "of type complex"),
        (threading.Lock(), "of type lock"),
    ],
)
def test_what_no_record_can_hold_is_named_and_the_run_has_failed(tmp_path: Path, value: object, named: str) -> None:
    for step in ("point", "finish"):
        folder = tmp_path / step
        with pytest.raises(RangeError, match=f"a: .* is {named}"), Recorder.create(folder, HEADER) as record:
            record.point({"b": 1.0}, {}, 1)
            if step == "point":
                record.point({"a": [value]}, {}, 2)
            record.finish("complete", {"a": [value]})
        run = palpate.read(folder)
        assert (run.status, len(run.points())) == ("failed", 1)


@pytest.mark.parametrize(
    ("waveform", "message"), [(np.ones(3) * 1j, "are complex128"), (["x"], "are <U1"), (np.array([{}]), "are object")]
)
def test_samples_that_are_no_real_numbers_are_refused_and_a_list_of_numbers_is_a_waveform(
    tmp_path: Path, waveform: Any, message: str
) -> None:
    with Recorder.create(tmp_path, HEADER) as record:
        record.point({}, {"a": (1.0, [1, 2.5])}, 1)  # type: ignore[dict-item]
        with pytest.raises(RangeError, match=f"waveform 'a': .* {message}"):
            record.point({}, {"a": (1.0, waveform)}, 1)
    assert [each.samples.tolist() for each in palpate.read(tmp_path).waveforms()] == [[1.0, 2.5]]


def test_json_shows_what_a_record_holds(capsys: pytest.CaptureFixture[str]) -> None:
    Output(as_json=True, quiet=False).json({"a": math.nan, "b": np.arange(2), "c": np.float32(0.5), "d": [math.inf]})
    assert "".join(capsys.readouterr().out.split()) == '{"a":null,"b":[0,1],"c":0.5,"d":[null]}'
