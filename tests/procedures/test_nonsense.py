"""What nobody can mean is refused or named: what procedures return, numbers of no bench, settings of any length."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import tomli_w

import palpate
import palpate as package
from palpate import BenchError, ConfigError, PalpateError, RangeError, UsageError, get_design
from palpate.extend import (
    Lab,
    Measurement,
    Plan,
    Procedure,
    Question,
    Recorder,
    SimpleResult,
    Step,
    Target,
    driven,
    read_scene,
)
from palpate.instrument.calibration.files import read_calibration, write_calibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.quantity import parse
from palpate.instrument.sensor.sample import parse_samples
from palpate.procedures.commands.options import MANY, Output
from palpate.procedures.engine.conduct import asked, conduct
from palpate.procedures.engine.run import prepared
from palpate.procedures.lab.session import reserved
from palpate.procedures.lab.store import result_folder
from palpate.procedures.records.export import export
from palpate.procedures.study.results import read_results
from palpate.simulators.clock import VirtualClock
from tests.benchmarks.faults import cases
from tests.conftest import Install
from tests.procedures.conftest import HEADER, IDEAL_SCENE, Palpate, scene_of


@dataclass(frozen=True)
class Point:
    x: float


@dataclass(frozen=True)
class Other:
    x: float


class Usual(Procedure[Any, Any, Any]):
    """A procedure of one step."""

    name, point = "nonsense", Point

    def plan(self, target: Target) -> Any:
        return Plan("nonsense", [Step(None, 1.0, None)])

    def begin(self, plan: Any, lab: Lab, record: Recorder) -> Any:
        return self

    def arrange(self, step: Step) -> None: ...

    def take(self, step: Step) -> Any:
        return Measurement(Point(1.0))

    def end(self) -> None: ...

    def evaluate(self, points: Any, plan: Any, lab: Lab) -> Any:
        return SimpleResult(points)


def nonsense(**returned: Any) -> Usual:
    """One of which some methods return something else."""
    methods = {name: Mock(return_value=value) for name, value in returned.items()}
    found: Usual = type("Nonsense", (Usual,), methods)()
    return found


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
        conduct(nonsense(**returned), lab, record)
    assert record.points == (1 if "evaluate" in returned else 0)


def test_what_a_procedure_asks_a_model_is_a_question(lab: Lab) -> None:
    assert asked(nonsense(), lab.design) is None
    with pytest.raises(ConfigError, match="model_question returned 'surface'; it must return a Question or None"):
        asked(nonsense(model_question="surface"), lab.design)


@pytest.mark.parametrize("name", ["simulated", "run", "seed", "mounting", "points", "plot", "bench_seconds"])
def test_a_finding_cannot_stand_in_for_what_palpate_says_of_the_run(lab: Lab, tmp_path: Path, name: str) -> None:
    found = SimpleResult([], {name: False})
    assert name in reserved()
    with (
        Recorder.create(tmp_path, HEADER) as record,
        pytest.raises(ConfigError, match=f"'nonsense': its result has a value '{name}', which palpate gives"),
    ):
        conduct(nonsense(evaluate=found), lab, record)


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


# --- numbers that no bench has -------------------------------------------------------------------------


SMALL = ("sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s")
# in which every effect, and every key of a fault, stands once
EVERYTHING = ("everything", "with voltage_amplifier", "fault film_drift", "fault babbling_node", "fault emergency")


@pytest.mark.slow
def test_a_number_that_no_bench_has_is_refused_in_one_line_or_can_be_computed_with(tmp_path: Path) -> None:
    file, refused = tmp_path / "hostile.toml", 0
    tried = [case for case in cases() if case.scene in EVERYTHING]
    for case in tried:
        file.write_text(tomli_w.dumps(dict(case.content)), encoding="utf-8")
        try:
            read_scene(str(file))
            assert not case.value or 1e-30 <= abs(case.value) <= 1e30, case  # 0, or of a size that a bench may have
        except ConfigError as error:
            assert str(error).startswith(f"{file}: ") and "\n" not in str(error), case
            refused += 1
    assert 500 < refused < len(tried)


@pytest.mark.parametrize(
    ("key", "value", "limit"),
    [
        ("coil_resistance", "1e-308 ohm", "is too small; give at least 1 mohm"),
        ("coil_resistance", "1e308 ohm", "is too large; give at most 1 Mohm"),
        ("force_constant", "1e308 N/A", "is too large; give at most 10 kN/A"),
        ("suspension_stiffness", "1e-308 N/m", "is too small; give at least 1 N/m"),
        ("sensor_position", "1e308 m", "is too large; give at most 1 m"),
    ],
)
def test_a_part_of_the_shaker_that_nobody_can_build_is_refused_with_its_limit(
    key: str, value: str, limit: str, palpate: Palpate
) -> None:
    Path("my.toml").write_text(f'{IDEAL_SCENE}[rig]\n{key} = "{value}"\n', encoding="utf-8")
    said = palpate(*SMALL, "--scene", "my.toml").refusal
    assert said.startswith(f"my.toml: rig.{key}: ") and limit in said


WET_GLUE = """
from typing import ClassVar
import numpy as np
from pydantic import Field
from palpate.simulators.physics.effect import FilmsEffect

class WetGlue(FilmsEffect):
    kind: ClassVar = "lti"
    cancels_in_ratio: ClassVar[bool] = True
    loss: float = Field(default=0.1, strict=True)

    def matrix(self, design, stream, set_at_ns):
        if set_at_ns > 65_000_000_000:  # while it is driven, so in the thread of the simulated devices
            raise OverflowError("glue everywhere")
        return (1 - self.loss) * np.eye(len(design.films))
"""


@pytest.fixture
def wet_glue(install: Install) -> str:
    install("acme", "palpate.effects", {"wet_glue": "wet_glue:WetGlue"}, wet_glue=WET_GLUE)
    return f"{IDEAL_SCENE}[effects.wet_glue]\n"


@pytest.mark.parametrize("loss", ["1e-308", "-1e308", "1e31"])
def test_an_effect_of_another_package_has_no_number_that_cannot_be_computed_with(
    loss: str, wet_glue: str, palpate: Palpate
) -> None:
    Path("my.toml").write_text(f"{wet_glue}loss = {loss}\n", encoding="utf-8")
    said = palpate(*SMALL, "--scene", "my.toml")
    assert said.complaint == (
        f"my.toml: effects.wet_glue: loss = {float(loss):g} is no size that can be computed with; give 0, or 1e-30 to "
        "1e+30 of either sign"
    )


def test_what_fails_in_a_simulated_device_is_told_once_and_by_whom_and_a_script_gets_the_first_cause(
    wet_glue: str, palpate: Palpate
) -> None:
    Path("my.toml").write_text(wet_glue, encoding="utf-8")
    said = palpate(*SMALL, "--scene", "my.toml", "--out", "run")
    assert said.status == 1
    assert said.complaint.startswith("acme 1.2: WetGlue.matrix failed: OverflowError: glue everywhere")
    sweep: Any = package.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.2)
    first = pytest.raises(BenchError, match="the scene cannot be simulated: OverflowError: glue everywhere; look for")
    with first, package.open_bench(scene="my.toml") as bench:
        package.run(sweep, bench, out="script")


def test_a_clock_that_failed_says_so_to_whoever_waits() -> None:
    clock = VirtualClock()
    told = clock.failed(ZeroDivisionError("float division by zero"))
    assert clock.failed(ValueError("a later one")) is not told
    with pytest.raises(BenchError, match="cannot be simulated: ZeroDivisionError: float division by zero"):
        clock.wait(1.0)
    assert clock.now_ns() == 0


def test_a_motion_is_followed_no_further_than_somebody_wants(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    scene = scene_of(f'{IDEAL_SCENE}[effects.current_limit]\nlimit = "10 mA"\n', tmp_path)
    clock = VirtualClock()
    rig = driven(scene, Question("1", 3.0), clock)
    monkeypatch.setattr("palpate.simulators.clock.PATIENCE", -1.0)
    clock.give_up_soon()
    with pytest.raises(BenchError, match="the simulation was interrupted"):
        rig.transitions(1_000_000_000)
    assert math.isfinite(rig.settled_for_ns())


# --- settings that are too long to be quoted, and names that no file can have --------------------------


COUNT = 100_000
NUL = "a\0b"
TARGET = Target(get_design("single"), 10.0, 1)


@pytest.mark.parametrize(
    "procedure",
    [
        palpate.LoadSweep(loads=("x",) * 1000),  # type: ignore[arg-type]
        palpate.LoadSweep(loads=(3.0, 2.0) * COUNT),
        palpate.LoadSweep(samples=("1",) * COUNT),
        palpate.LoadSweep(samples=("x" * COUNT,)),
        palpate.ModulusTest("1", strain="x" * COUNT),  # type: ignore[arg-type]
        palpate.LoadCellSeries(loads=(2.0,) * COUNT),
    ],
    ids=["types", "loads", "samples", "name", "text", "weights"],
)
def test_of_a_long_setting_a_message_quotes_a_few_values(procedure: Procedure) -> None:  # type: ignore[type-arg]
    with pytest.raises(PalpateError) as raised:
        prepared(procedure, TARGET)
    assert len(str(raised.value)) < 600


@pytest.mark.parametrize(
    "text", [",".join(["1"] * COUNT), "x" * COUNT, "1-" + " " * COUNT], ids=["many", "long", "wide"]
)
def test_of_a_long_text_a_message_quotes_the_beginning(text: str) -> None:
    for read in (parse_samples, lambda text: parse("9 " + text, "N")):
        with pytest.raises(PalpateError) as raised:
            read(text)
        assert len(str(raised.value)) < 600


def opened(**where: str) -> None:
    with palpate.open_bench(**where):  # type: ignore[arg-type]
        pass


def made(folder: Path) -> None:
    with result_folder(folder, "sweep-loads", datetime.now(UTC)):
        pass


@pytest.mark.parametrize(
    "use",
    [
        lambda: palpate.read(NUL),
        lambda: palpate.resume(NUL),
        lambda: opened(bench=NUL),
        lambda: opened(scene=NUL),
        lambda: opened(scene="ideal", log=f"{NUL}.pcapng"),
        lambda: made(Path(NUL)),
        lambda: read_calibration(NUL, LoadCellCalibration),
        lambda: write_calibration(Path(NUL), THESIS_LOAD_CELL),
        lambda: read_results(Path(NUL)),
        lambda: export(None, "csv", Path(NUL)),
    ],
    ids=["read", "resume", "bench", "scene", "log", "out", "calibration", "written", "study", "export"],
)
def test_a_name_with_a_zero_byte_is_refused(use: Callable[[], object]) -> None:
    with pytest.raises(UsageError, match=r"'a\\x00b(\.pcapng)?'"):
        use()


# --- the one JSON object that a command prints ---------------------------------------------------------


@pytest.mark.parametrize("entries", [0, MANY + 1])
def test_the_object_is_the_same_however_long_its_lists_are(entries: int, capsys: pytest.CaptureFixture[str]) -> None:
    value = {"name": 'a "line"\nbreak', "none": None, "points": [{"of": [n, n / 3]} for n in range(entries)], "of": {}}
    Output(as_json=True, quiet=False).json(value)
    said = capsys.readouterr().out
    assert json.loads(said) == value
    assert said == json.dumps(value, indent=2) + "\n" or entries > MANY


def test_each_entry_of_a_long_list_has_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Indented, 1,000 answers with the films of four teeth took longer to write than to find."""
    Output(as_json=True, quiet=False).json({"points": [{"a": [1, 2]}, {"a": [math.inf]}] * MANY})
    said = capsys.readouterr().out.splitlines()
    assert (len(said), said[2:4]) == (2 * MANY + 4, ['    {"a": [1, 2]},', '    {"a": [null]},'])
