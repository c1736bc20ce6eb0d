"""A run that was stopped goes on and ends as if it had not been, also in a chain; on another bench not unnoticed."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import MISSING, asdict, dataclass, fields
from datetime import UTC, datetime
from itertools import chain, repeat
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
import tomli_w

import palpate
from palpate import RecordError, Run, SoftnessTest, get_sample
from palpate.extend import Bench, Recorder, read_bench
from palpate.procedures.console.terminal import Progress
from palpate.procedures.engine.catalogue import SHIPPED, class_of
from palpate.procedures.lab import operator
from palpate.procedures.measurements.loads import LoadPoint, LoadSweep
from palpate.procedures.records.chain import HEAD_FILE
from palpate.procedures.records.record_file import as_json
from palpate.procedures.records.resumed import Resumed, header_of, settings_of
from palpate.procedures.steps.pause import NOBODY
from palpate.simulators.bench import SimulatedBench
from palpate.testing import steps
from tests.drivers.benches import new_form
from tests.examples.relaxation import Relaxation
from tests.procedures.conftest import HEADER, OFF, Palpate, interrupt_at, outputs
from tests.runs import rehash

SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N, 4 N", "--dwell", "0.2 s", "--quiet")
Stop = Callable[[int], None]


@pytest.fixture
def stop(on_progress: Any) -> Stop:
    """Has the next command interrupted when it has reported so many points; 0: never."""
    return lambda points: on_progress(interrupt_at(points or -1))


def stopped(palpate: Palpate, stop: Stop, points: int, *command: str) -> Run:
    """The run `cut`, interrupted after so many points."""
    stop(points)
    assert palpate(*command, "--out", "cut").status == 130
    stop(0)
    run = Run.open(Path("cut"))
    assert (run.status, len(run.points())) == ("stopped", points)
    return run


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was confirmed by somebody who always does as he is asked."""
    words: list[str] = []

    def confirm(what: str, word: str) -> None:
        words.append(f"{word} anew" if "anew" in what else word)

    monkeypatch.setattr(operator, "confirm", confirm)
    return words


@pytest.fixture
def person(lab: str, asked: list[str]) -> str:
    """The bench file of `lab`, with that person at its console."""
    return lab


def events(folder: str) -> list[str]:
    return [event["kind"] for event in Run.open(Path(folder)).events()]


@pytest.fixture
def whole(palpate: Palpate) -> Run:
    assert palpate(*SWEEP, "--out", "whole").status == 0
    return Run.open(Path("whole"))


def test_every_procedure_is_found_by_the_name_in_its_header_and_has_its_settings_back() -> None:
    found = {name: class_of(run_of({}, name), "resumed") for name in SHIPPED}
    assert [procedure.name for procedure in found.values()] == list(found)
    on_real_benches = {name for name, procedure in found.items() if procedure.resumable_on_real_bench}
    assert on_real_benches == {"sweep-loads", "sweep-frequency", "measure-modulus"}
    for settings in (
        LoadSweep(("1",), (2.0, 3.0), 0.2, 10.0, extrapolate=True),
        SoftnessTest((get_sample("2"),), (2.0,), 1.0, 10.0, "experiment"),
    ):
        stored = run_of(json.loads(as_json({"settings": asdict(settings)})))
        assert settings_of(stored, type(settings)) == settings


# --- what has changed -----------------------------------------------------------------------------------


def test_a_change_is_named_and_refused_unless_it_is_accepted(palpate: Palpate, stop: Stop) -> None:
    before = stopped(palpate, stop, 2, *SWEEP).points()
    scene = Path("cut/scene.toml")
    scene.write_text(scene.read_text().replace("seed = 1", "seed = 2"))
    for changed, to in (("versions", {"numpy": "1.0"}), ("calibration", {"zero_mV": 9.5})):
        rehash(Path("cut"), header=lambda header, changed=changed, to=to: header[changed].update(to))  # type: ignore[misc]
    said = palpate("runs", "resume", "cut").refusal
    for told in (
        "scene.seed: 1 in the record, 2 now\n",
        'versions.numpy: "1.0" in the record',
        "calibration.zero_mV: 9.5 in the record, 1.",
    ):
        assert told in said
    assert said.endswith("or resume with --accept-change, which is recorded")
    assert events("cut") == ["stopped"]
    assert palpate("runs", "resume", "cut", "--accept-change", "--quiet").status == 0
    run = Run.open(Path("cut"))
    assert (run.status, run.points()[:2], len(run.points())) == ("complete", before, 3)
    messages = [event["message"] for event in run.events() if event["kind"] == "changed"]
    assert messages[3:] == [f"point {n} is not what the bench gives now" for n in (1, 2)]


def test_points_that_come_out_otherwise_stop_it(palpate: Palpate, stop: Stop) -> None:
    stopped(palpate, stop, 2, *SWEEP)
    rehash(Path("cut"), point=lambda data: data.update(force_ratio=0.5), number=2)
    assert "point 2 is not what the bench gives now" in palpate("runs", "resume", "cut").complaint
    assert len(Run.open(Path("cut")).points()) == 2


def test_what_cannot_go_on_is_refused(palpate: Palpate, whole: Run) -> None:
    resume = ("runs", "resume", "whole")
    assert "is complete; there is nothing to resume" in palpate(*resume).complaint
    rehash(whole.folder, status="running")
    with Resumed(Run.open(whole.folder), replay=True, accept=False):
        assert "is being written by another process" in palpate(*resume).complaint
    rehash(whole.folder, status="running")
    assert "leave this option out" in palpate(*resume, "--bench", "lab.toml").complaint
    rehash(whole.folder, header=lambda header: header.update(procedure="reproduce"))
    assert "'reproduce' cannot be resumed without its class: " in palpate(*resume).complaint
    (whole.folder / HEAD_FILE).unlink()
    assert "salvage it with palpate runs repair" in palpate(*resume).complaint


BEGUN: dict[str, Any] = {
    **HEADER, "settings": {}, "scene": {"toml": ""}, "bench": "", "devices": {}, "contracts": "", "calibration": {},
    "film_calibration": None, "versions": {},
}  # fmt: skip
FORGED: dict[str, list[object]] = {
    "settings": [3, None, [{}]],
    "scene": [3, "[", {}, {"toml": 1}, {"toml": "["}],
    "bench": [3, None],
    "devices": [3, {"generator": 1}],
    "contracts": [3],
    "calibration": [3, None],
    "film_calibration": [3, "x"],
    "versions": [3, {"numpy": 2}],
}
FORGERIES = [
    *(BEGUN | {key: value} for key, values in FORGED.items() for value in values),
    *({key: value for key, value in BEGUN.items() if key != absent} for absent in FORGED),
    BEGUN | {"scene": None, "bench": "["},
]


def run_of(header: dict[str, Any], name: str = "sweep-loads") -> Run:
    return Run(Path("run"), name, True, datetime.now(UTC), "stopped", header, {})


def test_a_header_that_was_forged_is_refused() -> None:
    assert header_of(run_of(BEGUN)) == BEGUN
    for header in FORGERIES:
        with pytest.raises(RecordError, match=r"^run: its header is not that of a procedure on .* \(.*\); run anew$"):
            header_of(run_of(header))


@dataclass
class Levels:
    values: int | tuple[float, ...]


@pytest.mark.parametrize(
    ("read", "settings"),
    [
        (LoadSweep.recorded, {}),
        (LoadSweep.recorded, {"samples": None, "loads": [None]}),
        (lambda run: settings_of(run, Levels), {"values": [None]}),
    ],
)
def test_settings_that_were_forged_or_have_a_null_where_no_number_belongs_are_refused(
    read: Callable[[Run], object], settings: dict[str, Any]
) -> None:
    told = r"^run: its settings were recorded by another version of palpate \(.*\); run anew$"
    with pytest.raises(RecordError, match=told):
        read(run_of(BEGUN | {"settings": settings}))


def test_what_was_forged_is_one_error_at_the_command_line(palpate: Palpate) -> None:
    for folder, header, what in (("one", BEGUN | {"devices": 3}, "header"), ("two", BEGUN, "settings")):
        Recorder.create(Path(folder), header).close()
        said = palpate("runs", "resume", folder)
        assert said.status == 1
        assert said.complaint.startswith(f"{Path(folder).absolute()}: its {what} ")


# --- a real bench ---------------------------------------------------------------------------------------


def test_a_real_bench_begins_at_the_next_point_where_it_is_the_same(
    palpate: Palpate, stop: Stop, person: str, asked: list[str], sim: SimulatedBench
) -> None:
    two_samples = ("sweep", "loads", "--samples", "1,2", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--quiet")
    before = stopped(palpate, stop, 3, *two_samples, "--bench", person).points()
    ended = sim.clock.now_ns()
    Path("other.toml").write_text(tomli_w.dumps(new_form(read_bench(Path(person))) | {"force_limit": "9.0 N"}))
    said = palpate("runs", "resume", "cut", "--bench", "other.toml").complaint
    assert 'bench.force_limit: "10.0 N" in the record, "9.0 N" now' in said
    assert said.count("in the record") == 1  # its new form changes nothing
    result = palpate("runs", "resume", "cut", "--bench", "other.toml", "--accept-change", "--json").object
    points = Run.open(Path("cut")).points()
    assert (Run.open(Path("cut")).status, points[:3]) == ("complete", before)
    assert [(p["sample"], p["load_N"]) for p in points] == [("1", 2.0), ("1", 3.0), ("2", 2.0), ("2", 3.0)]
    assert points[3]["bench_ns"] > ended + 60e9  # the sample is mounted anew
    assert (asked, result["mounting"]) == (["1", "2", "2"], "confirmed")
    assert [p["force_ratio"] for p in result["points"]] == [p["force_ratio"] for p in points]
    assert (events("cut"), outputs(sim)) == (["stopped", "continued", "changed"], OFF)


@pytest.mark.slow
def test_the_measurement_of_a_modulus_goes_on_on_a_real_bench_and_ends_when_it_has_enough(
    palpate: Palpate, stop: Stop, person: str, asked: list[str], sim: SimulatedBench
) -> None:
    stated = ("--relative-to-model", "--mounting-scatter", "0 %", "--quiet")
    modulus = ("measure", "modulus", "--sample", "1", "--tolerance", "20 %", *stated)
    before = stopped(palpate, stop, 4, *modulus, "--bench", person).points()
    result = palpate("runs", "resume", "cut", "--json").object
    run = Run.open(Path("cut"))
    assert (run.status, run.points()[:4]) == ("complete", before)
    assert (result["sets"], result["mountings"], result["achieved_seconds"]) == (10, 2, None)
    assert ([point["mounting"] for point in run.points()], asked) == (4 * [1] + 6 * [2], ["1", "1 anew"])
    assert (events("cut"), outputs(sim)) == (["stopped", "continued", "enough"], OFF)


@pytest.mark.slow
def test_a_run_that_goes_on_without_a_terminal_says_what_it_assumes(
    palpate: Palpate, stop: Stop, person: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = stopped(palpate, stop, 1, *SWEEP, "--bench", person)
    assert run.header["mounting"] == "confirmed"
    monkeypatch.setattr(operator, "at_terminal", lambda: False)
    assert "--assume-mounted" in palpate("runs", "resume", "cut").refusal
    assert events("cut") == ["stopped"]
    result = palpate("runs", "resume", "cut", "--assume-mounted", "--json").object
    assert (result["mounting"], Run.open(Path("cut")).header["mounting"]) == ("assumed", "assumed")


def test_points_that_belong_together_do_not_go_on_on_a_real_bench(palpate: Palpate, stop: Stop, person: str) -> None:
    stopped(palpate, stop, 1, "calibrate", "load-cell", "--bench", person, "--quiet")
    assert "cannot be resumed" in palpate("runs", "resume", "cut").complaint


def test_a_stored_null_is_read_back_as_nan(tmp_path: Path) -> None:
    known = {"sample": "1", "load_N": 2.0, "valid": False, "flags": ("not finite",)}
    needed = dict.fromkeys((field.name for field in fields(LoadPoint) if field.default is MISSING), math.nan)
    point = LoadPoint(**{**needed, **known})  # type: ignore[arg-type]
    with Recorder.create(tmp_path, {**HEADER, "settings": {}}) as record:
        record.point(asdict(point), {}, 5)
    with Resumed(Run.open(tmp_path), replay=False, accept=False) as resumed:
        (again,) = resumed.finished(LoadPoint)
        assert (repr(again), resumed.bench_ns) == (repr(point), 5)


# --- runs on one open bench, one after the other -------------------------------------------------------

CELL = palpate.LoadCellSeries(loads=(1.4, 3.3, 7.2), runs=1, creep=False)
FILMS = palpate.FilmSeries(loads=(2.0, 3.0, 4.0), dwell=0.2)
SWEPT = palpate.LoadSweep(samples=("2",), loads=(2.0, 3.0), dwell=0.2)
CHAIN = (CELL, FILMS, SWEPT)


def copying(run: Path, into: Path, at: list[int]) -> Progress:
    """A progress that copies a run whenever something is reported: what is on disk then is what a kill would leave."""

    def copy(done: int, _total: int, _what: str) -> None:
        if done not in at:
            at.append(done)
            shutil.copytree(run, into / f"{run.name}-{done}")

    return copy


@pytest.mark.usefixtures("own_store")
@pytest.mark.slow
def test_each_run_of_a_chain_that_was_killed_at_any_point_ends_as_it_would_have(tmp_path: Path) -> None:
    killed = tmp_path / "killed"
    whole, at = [], {}
    with palpate.open_bench(scene="ideal") as bench:
        for number, procedure in enumerate(CHAIN):
            out, cuts = tmp_path / f"run{number}", at.setdefault(number, [])
            found = palpate.run(procedure, bench, out=out, listeners=[steps(copying(out, killed, cuts))])
            whole.append((found.run.digest(), found.run.summary))
            cuts.pop()  # complete
    assert (at[1], at[2]) == ([0, 1, 2], [0, 1])
    for number in (2, 1):  # what was stored when the last was interrupted is still stored
        for points in at[number]:
            again = palpate.resume(killed / f"run{number}-{points}")
            assert (again.run.digest(), again.run.summary) == whole[number], (number, points)
            assert again.outcome["achieved_seconds"] == whole[number][1]["achieved_seconds"]


FAULTY = """
name = "faulty"
purpose = "A chain in which runs get wrong replies, and sensors drift."
design = "single"
[effects.humidity_leak]
[effects.white_noise]
[[fault]]
kind = "wrong_count"
on = "shaker_amplifier"
probability = 0.04
"""


@pytest.mark.usefixtures("own_store")
@pytest.mark.slow
def test_what_happened_before_a_run_happens_again(tmp_path: Path) -> None:
    """Pauses, incidents, and the time that a script lets pass between two runs."""
    scene, killed = tmp_path / "scene.toml", tmp_path / "killed"
    scene.write_text(FAULTY)
    whole = {}
    once = Mock(asked=Mock(side_effect=chain([True], repeat(False))))  # it asks for a pause before a point
    with palpate.open_bench(scene=scene) as bench:
        for number, pause in enumerate((NOBODY, once, NOBODY)):
            bench.bench.clock.wait(60.0 * number)
            out = tmp_path / f"run{number}"
            done = palpate.run(SWEPT, bench, out=out, listeners=[steps(copying(out, killed, []))], pause=pause)
            whole[number] = done.run
    assert [{event["kind"] for event in run.events()} for run in whole.values()] == [
        {"incident"},
        {"incident", "paused", "resumed"},
        {"incident"},
    ]
    assert len({run.digest() for run in whole.values()}) == len(whole)
    for number, run in list(whole.items())[1:]:
        again = palpate.resume(killed / f"run{number}-1").run
        assert again.digest() == run.digest(), number
        assert again.header.get("before") == run.header.get("before")


@pytest.mark.usefixtures("own_store")
@pytest.mark.parametrize(
    ("runs", "something_else"),
    [
        (0, lambda bench: bench.operator.mount(palpate.get_sample("3"))),
        (1, lambda bench: bench.device("strain_indicator").set(filter=0.4)),
    ],
)
def test_a_run_after_something_that_nobody_knows_says_as_it_begins_that_it_cannot_be_resumed(
    runs: int, something_else: Callable[[Bench], None], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with palpate.open_bench(scene="ideal") as bench, pytest.raises(KeyboardInterrupt) as ended:
        for number in range(runs):
            palpate.run(Relaxation(readings=1), bench, out=tmp_path / str(number))
        assert "cannot be resumed" not in capsys.readouterr().err
        something_else(bench.bench)
        palpate.run(Relaxation(), bench, out=tmp_path / "last", listeners=[steps(interrupt_at(1))])
    when = "after run 1" if runs else "before its first run"
    why = f"something else was done with the bench {when}"
    assert capsys.readouterr().err == f"palpate: note: this run cannot be resumed if it is interrupted: {why}\n"
    assert not any("palpate runs resume" in note for note in ended.value.__notes__)
    with pytest.raises(palpate.UsageError, match=f"last: the simulated bench cannot be brought back .*: {why}; run it"):
        palpate.resume(tmp_path / "last", Relaxation)


@dataclass(frozen=True)
class Slower(Relaxation):
    name = "slower relaxation"
    readings: int = 3


@pytest.mark.usefixtures("own_store")
def test_a_run_after_those_of_a_script_goes_on_where_their_classes_are_known(
    tmp_path: Path,
) -> None:
    with palpate.open_bench(scene="ideal") as bench:
        palpate.run(Slower(), bench, out=tmp_path / "first")
        out = tmp_path / "second"
        whole = palpate.run(SWEPT, bench, out=out, listeners=[steps(copying(out, tmp_path / "killed", []))])
    cut = tmp_path / "killed" / "second-1"
    shutil.rmtree(tmp_path / "first")  # the second one's header tells enough
    gone = shutil.copytree(cut, tmp_path / "gone")
    rehash(gone, header=lambda header: header["before"]["runs"]["1"]["header"].update(procedure="uninstalled"))
    with pytest.raises(palpate.UsageError, match=r"first: 'uninstalled' .* cannot be resumed without its class"):
        palpate.resume(gone)
    assert palpate.resume(cut).run.digest() == whole.run.digest()
