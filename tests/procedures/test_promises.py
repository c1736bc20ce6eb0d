"""`palpate accuracy promises` compares what runs were predicted to take and to give with what they took and gave."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from palpate.procedures.accuracy.promises import promises
from palpate.procedures.records.record import Recorder
from tests.procedures.conftest import HEADER, Palpate


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
    assert simulated["u_over_predicted"]["mean"] == pytest.approx(1.5)
    assert simulated["within_bound"] == {"count": 2, "share": 0.5}
    (ratio,) = simulated["results"]
    assert ratio["name"] == "ratio"
    assert ratio["u_over_predicted"] == {"count": 2, "mean": pytest.approx(1.0), "least": 0.5, "greatest": 1.5}
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
    assert "1 run of an older version without a promise" in said.out
    assert "cannot be read: broken" in said.out


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
