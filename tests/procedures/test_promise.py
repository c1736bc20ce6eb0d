"""What plans predict is kept by runs: the bench time within a tenth, and the uncertainty of each result within bounds.

A scatter that is known before stands for that of a run's own points. So a film's scatter from a few points may be well
below or above the prediction; the bounds of a case say by how much.
"""

from __future__ import annotations

import math
import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

import palpate
from palpate import (
    Characterisation,
    FilmSeries,
    FrequencySweep,
    LoadCellSeries,
    LoadSweep,
    ModulusTest,
    PositionSweep,
    Reference,
    ReferenceSeries,
    SoftnessTest,
    TemperatureSweep,
    get_design,
    get_sample,
)
from palpate.extend import Procedure, Recorder, Target
from palpate.procedures.accuracy.promises import promises
from palpate.procedures.lab.chosen import choose
from palpate.procedures.lab.session import Outcome
from tests.procedures.conftest import HEADER, Palpate

pytestmark = pytest.mark.usefixtures("own_store")

TIME = (0.9, 1.1)


@dataclass(frozen=True)
class Case:
    """A procedure, its scene, how many seeds, and bounds of achieved over predicted uncertainty.

    `rms` bounds the root mean square over the seeds, for each result.
    """

    procedure: Procedure[Any, Any, Any]
    rms: tuple[float, float]
    scene: str = "thesis_single"
    seeds: int = 1


REFERENCES = (Reference("A", 40e3, 0.02), Reference("B", 90e3, 0.02))
QUICK = [
    Case(LoadCellSeries(), (0.9, 1.15)),
    Case(LoadSweep(("1",), (2.0, 4.0), 0.2), (0.95, 1.05)),
]
THOROUGH = [
    Case(LoadCellSeries(runs=2, positions=(0.0, 120.0)), (0.7, 1.3), seeds=2),
    Case(LoadSweep(("1", "5")), (0.97, 1.03), seeds=2),
    Case(SoftnessTest(tuple(get_sample(name) for name in "34"), model="auto"), (0.9, 1.1), seeds=2),
    Case(FilmSeries((2.0, 3.0, 4.0), (5.0, 20.0)), (0.6, 1.4), "thesis_different_base", seeds=8),
    Case(FrequencySweep((0.2, 1.0, 10.0, 50.0), load=4.0), (0.85, 1.15), seeds=2),
    Case(ModulusTest("1", strain=0.2, steps=6), (0.9, 1.1), seeds=2),
    Case(Characterisation(drift_time=60.0), (0.4, 1.7), seeds=2),
    Case(PositionSweep(), (0.5, 1.7), "thesis_common_base", seeds=2),
    Case(ReferenceSeries(REFERENCES), (0.85, 1.25), seeds=2),
    Case(TemperatureSweep(), (0.95, 1.15), "humid_body"),
]
TARGETED = [
    Case(LoadSweep(("2",), (3.0, 4.0), tolerance=0.06), (0.6, 1.5)),
    Case(FilmSeries((2.0, 3.0, 4.0), dwell=0.2, tolerance=0.03), (0.6, 1.5)),
    Case(SoftnessTest(tuple(get_sample(name) for name in "34"), model="auto", risk=0.05), (0.6, 1.5)),
    Case(Characterisation(drift_time=60.0, tolerance=0.04), (0.5, 1.6)),
]


def _outcomes(case: Case) -> list[Outcome]:
    found = []
    for seed in range(1, case.seeds + 1):
        with palpate.open_bench(scene=case.scene, seed=seed) as bench:
            found.append(palpate.run(case.procedure, bench).outcome)
    return found


def _check(case: Case) -> None:
    outcomes = _outcomes(case)
    times = [one["achieved_seconds"] / one["predicted_seconds"] for one in outcomes]  # type: ignore[operator]
    assert TIME[0] <= math.fsum(times) / len(times) <= TIME[1]
    results = outcomes[0]["predicted_results"]
    assert results
    for row in results:
        reached = [each["u"] for one in outcomes for each in one["achieved_results"] if each["name"] == row["name"]]
        assert len(reached) == len(outcomes), f"{row['name']} was predicted, and not found"
        rms = math.sqrt(math.fsum(u**2 for u in reached) / len(reached))
        assert case.rms[0] <= rms / row["u"] <= case.rms[1], row["name"]


def _named(case: Case) -> str:
    return f"{case.procedure.name}-{case.scene}"


@pytest.mark.parametrize("case", QUICK, ids=_named)
def test_a_short_run_keeps_what_its_plan_predicts(case: Case) -> None:
    _check(case)


@pytest.mark.slow
@pytest.mark.parametrize("case", THOROUGH, ids=_named)
def test_a_run_keeps_what_its_plan_predicts(case: Case) -> None:
    _check(case)


COMMANDS = (
    "calibrate load-cell",
    "calibrate films",
    "calibrate model --model experiment --reference 'A: 48 kPa ± 2 %'",
    "test modulus --sample 4",
    "characterise",
    "softness --modulus '48 kPa'",
)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_dry_run_tells_time_and_uncertainty_of_each_result(palpate: Palpate, command: str) -> None:
    words = shlex.split(command)
    plan = palpate(*words, "--dry-run", "--json").object
    assert plan["dry_run"]
    assert plan["predicted_seconds"] == pytest.approx(math.fsum(point["seconds"] for point in plan["points"]))
    relative = [row["u"] for row in plan["predicted_results"] if row["unit"] == "relative"]
    assert min(relative) > 0
    assert plan["predicted_u"] == max(relative) < 1


@pytest.mark.parametrize(
    ("command", "names"),
    [
        ("sweep loads --samples 1,2 --tolerance '2 %'", ["force ratio of sample 1", "force ratio of sample 2"]),
        ("calibrate films --tolerance '2 %'", ["sensitivity of film rigid", "sensitivity of film total"]),
        ("measure modulus --sample 4 --tolerance '5 %' --relative-to-model --model surface", ["modulus, scale"]),
        ("softness --samples 3,4 --risk '5 %' --model experiment", ["force ratio of 3", "force ratio of 4",
                                                                 "modulus of 3, scale", "modulus of 4, scale"]),
    ],
)  # fmt: skip
def test_a_plan_with_a_target_tells_the_uncertainty_of_each_result(
    palpate: Palpate, command: str, names: list[str]
) -> None:
    plan = palpate(*shlex.split(command), "--dry-run", "--json").object
    told = {row["name"]: row["u"] for row in plan["predicted_results"] if "absolute" not in row["name"]}
    assert list(told) == names
    assert 0 < min(told.values()) <= max(told.values()) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("case", TARGETED, ids=_named)
def test_a_run_with_a_target_has_each_result_that_its_plan_predicts(case: Case) -> None:
    """The first load sets tell how many there are: the time of one run scatters by a tenth."""
    _check(case)


def test_a_load_cell_that_is_turned_takes_the_time_to_turn_it() -> None:
    once, turned = (LoadCellSeries(positions=places).plan(choose(None).target) for places in ((0.0,), (0.0, 120.0)))
    assert turned.seconds == pytest.approx(2 * (once.seconds + 60))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("procedure", "design"),
    [
        (FilmSeries(dwell=0.1), "single"),
        (FilmSeries(tolerance=0.02), "single"),
        (FrequencySweep(), "single"),
        (LoadSweep(("1",), (2.0, 4.0), 0.2), "single"),
        (LoadSweep(("1",), (2.0, 4.0), tolerance=0.02), "single"),
        (TemperatureSweep(), "single"),
        (Characterisation(), "single"),
        (PositionSweep(positions=(0.012,)), "common_base"),
        (PositionSweep(positions=(0.012,), tolerance=1e-3), "common_base"),
    ],
    ids=lambda each: getattr(each, "name", each),
)
def test_every_plan_takes_the_noise_that_the_bench_file_states(
    procedure: Procedure[Any, Any, Any], design: str
) -> None:
    usual = Target(get_design(design), 10.0, nodes=1)
    noisy = replace(usual, design=usual.design.with_noise(2e-4))
    quiet, loud = (procedure.plan(target).predicted for target in (usual, noisy))
    before, after = ([each["u"] for each in planned.details["predicted_results"]] for planned in (quiet, loud))
    assert after > before or loud.seconds > 1.2 * quiet.seconds, (before, after)


# --- `palpate accuracy promises` compares what runs were predicted to take and to give with wha -------


def run(name: str, procedure: str = "measure-modulus", simulated: bool = True, **summary: Any) -> None:
    """A complete run of a store with this summary."""
    with Recorder.create(Path("runs") / name, {**HEADER, "procedure": procedure, "simulated": simulated}) as record:
        record.finish("complete", summary)


def promise(seconds: float, taken: float | None, u: float | None, reached: float | None) -> dict[str, float | None]:
    return {"predicted_seconds": seconds, "achieved_seconds": taken, "predicted_u": u, "achieved_u": reached}


def results(predicted: float, achieved: float) -> dict[str, Any]:
    """Of two results, the second of which the run does not have."""
    told = [{"name": name, "u": predicted, "unit": unit} for name, unit in (("ratio", "relative"), ("place", "mm"))]
    return {"predicted_results": told, "achieved_results": [{**told[0], "u": achieved}, {**told[1], "unit": "m"}]}


@pytest.fixture
def store(palpate: Palpate) -> Palpate:
    run("one", **promise(80.0, 88.0, 0.02, 0.03), **results(0.02, 0.03), planned={"longest_s": 87.0})
    run("two", **promise(100.0, 90.0, 0.02, None), **results(0.02, 0.01), planned={"longest_s": 110.0})
    run("real", simulated=False, **promise(100.0, None, 0.02, 0.02))
    run("sweep", "sweep-loads", **promise(50.0, 50.0, None, None))
    run("old", "sweep-loads", bench_seconds=50.0)
    with Recorder.create(Path("runs/cut"), HEADER):
        pass
    (Path("runs/one").parent / "broken").mkdir()
    Path("runs/broken/run.head").write_bytes(b"nothing")
    Path("runs/broken/run.record").write_bytes(b"nothing")
    return palpate


def test_achieved_over_predicted_values_are_gathered_by_procedure_and_kind_of_bench(store: Palpate) -> None:
    found = store("accuracy", "promises", "--json").object
    by = {(row["procedure"], row["simulated"]): row for row in found["procedures"]}
    assert by.keys() == {("measure-modulus", True), ("measure-modulus", False), ("sweep-loads", True)}
    simulated = by["measure-modulus", True]
    assert simulated["seconds_over_predicted"] == {
        "count": 2, "mean": pytest.approx(1.0), "least": pytest.approx(0.9), "greatest": pytest.approx(1.1),
    }  # fmt: skip
    assert (simulated["u_over_predicted"]["mean"], simulated["within_bound"]) == (
        pytest.approx(1.5),
        {"count": 2, "share": 0.5},
    )
    (ratio,) = simulated["results"]
    assert (ratio["name"], ratio["u_over_predicted"]) == (
        "ratio",
        {"count": 2, "mean": pytest.approx(1.0), "least": 0.5, "greatest": 1.5},
    )
    one = next(each for each in found["runs"] if each["run"] == "one")
    assert (one["within_bound"], one["bound_seconds"]) == (False, 87.0)
    assert [each["u_over_predicted"] for each in one["results"]] == [1.5, None]
    assert by["measure-modulus", False]["within_bound"] is None
    assert by["measure-modulus", False]["seconds_over_predicted"] is None
    assert by["sweep-loads", True]["u_over_predicted"] is None
    assert (found["without"], found["unreadable"], len(found["runs"])) == (1, ["broken"], 4)


def test_people_get_a_table(store: Palpate) -> None:
    said = store("accuracy", "promises")
    assert said.status == 0
    rows = " ".join(said.out.split())
    assert "measure-modulus simulated 2 1.000 0.90 to 1.10 50% of 2" in rows
    assert "measure-modulus ratio 2 1.000 0.50 to 1.50" in rows
    assert "1 run of an older version without a promise" in said.out and "cannot be read: broken" in said.out


def test_an_empty_store_has_no_promise_and_a_missing_one_is_refused(palpate: Palpate) -> None:
    assert "has no complete run with a promise" in palpate("accuracy", "promises").out
    assert (
        "is no folder; name one that holds runs with --store"
        in palpate("accuracy", "promises", "--store", "nowhere").complaint
    )
    assert promises(Path("nowhere")).runs == []


def test_every_run_keeps_its_promise_in_its_summary(palpate: Palpate) -> None:
    found = palpate("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s", "--json").object
    assert found["predicted_seconds"] == pytest.approx(found["achieved_seconds"], rel=0.1)
    kept = promises(Path("runs"))
    assert [(each.procedure, each.predicted_seconds) for each in kept.runs] == [
        ("sweep-loads", found["predicted_seconds"])
    ]
