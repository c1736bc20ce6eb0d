"""Listeners of a run, and `palpate.watch` in any other process, hear what happens in it; the run takes no notice."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import pytest

import palpate
from palpate.testing import InStep, steps
from tests.procedures.conftest import HEADER, Palpate, interrupt_at
from tests.runs import flip, made

SWEEP = palpate.LoadSweep(samples=("1", "2"), loads=(2.0, 3.0), dwell=0.2)
LIVE = ("step", "promise")  # what a record does not hold


def swept(out: Path, *listeners: Any) -> palpate.Run:
    with palpate.open_bench(scene="noisy_lab", seed=4) as bench:
        return palpate.run(SWEEP, bench, out=out, listeners=listeners).run


def test_a_listener_and_a_watcher_hear_the_same_and_it_is_what_the_record_holds_on_disk_already(
    tmp_path: Path,
) -> None:
    heard: list[palpate.Event] = []
    on_disk: list[tuple[int, int]] = []

    def look(event: palpate.Event) -> None:
        if event.kind == "point":
            on_disk.append((event.data["id"], len(palpate.read(tmp_path / "run").points())))

    run = swept(tmp_path / "run", heard.append, InStep(look))
    assert on_disk == [(number, number) for number in (1, 2, 3, 4)]
    assert list(palpate.watch(run.folder)) == [event for event in heard if event.kind not in LIVE]
    points = [{"bench_ns": e.bench_ns, "id": e.data["id"], **e.data["values"]} for e in heard if e.kind == "point"]
    assert points == run.points()
    kinds = [event.kind for event in heard]
    assert (kinds[:2], kinds[-1]) == (["begun", "planned"], "ended")
    assert (heard[1].data["points"], heard[-1].data["summary"]) == (4, run.summary)
    promises = [event.data for event in heard if event.kind == "promise"]
    left = [promise["seconds"] for promise in promises]  # it falls to what comes after the points
    assert left == sorted(left, reverse=True)
    assert left[0] == heard[1].data["seconds"] == run.summary["predicted_seconds"]
    assert (left[-1], promises[-1]["u"]) == (pytest.approx(0, abs=1e-9), run.summary["achieved_u"])


@pytest.mark.slow
def test_listeners_that_fail_or_hang_are_dropped_and_the_run_is_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heard: list[str] = []
    never = threading.Event()

    def failing(event: palpate.Event) -> None:
        raise SystemExit("no more")

    def hanging(event: palpate.Event) -> None:
        never.wait()

    alone = swept(tmp_path / "alone")
    among = swept(tmp_path / "among", hanging, failing, lambda event: heard.append(event.kind))
    never.set()
    assert (among.digest(), among.summary) == (alone.digest(), alone.summary)
    assert (heard.count("point"), heard[-1]) == (4, "ended")
    told = capsys.readouterr().err.splitlines()
    assert [line.split(" hears no more of this run: ")[1] for line in told] == [
        "it failed: SystemExit: no more",
        "it was busy with one event for more than 2 s when the run had ended",
    ]
    assert "failing" in told[0]


def test_a_watcher_that_comes_while_a_stopped_run_is_resumed_hears_it_to_its_new_end(tmp_path: Path) -> None:
    with palpate.open_bench(scene="noisy_lab", seed=4) as bench, pytest.raises(KeyboardInterrupt):
        palpate.run(SWEEP, bench, out=tmp_path / "run", listeners=[steps(interrupt_at(3))])
    assert list(palpate.watch(tmp_path / "run"))[-1].data["status"] == "stopped"
    heard: list[palpate.Event] = []
    watcher = threading.Thread(target=lambda: heard.extend(palpate.watch(tmp_path / "run")))

    def look(event: palpate.Event) -> None:
        if event.kind == "begun":
            watcher.start()
            while not any(each.kind == "incident" for each in heard):  # it has read to the end of the stopped run
                watcher.join(0.01)

    palpate.resume(tmp_path / "run", listeners=[InStep(look)])
    watcher.join()
    assert [event.data["status"] for event in heard if event.kind == "ended"] == ["complete"]
    assert [event.data["id"] for event in heard if event.kind == "point"] == [1, 2, 3, 4]


def test_nothing_is_told_of_a_run_that_is_none_and_a_damaged_one_is_named(tmp_path: Path) -> None:
    with pytest.raises(palpate.UnknownName, match="nothing"):
        palpate.watch(tmp_path / "nothing")
    made(tmp_path / "run", HEADER, (({"x": float(n)}, {}) for n in range(9)))
    flip(tmp_path / "run" / "run.record")
    with pytest.raises(palpate.RecordError, match=r"run\.record is damaged"):
        list(palpate.watch(tmp_path / "run"))


def test_a_command_writes_each_event_as_a_line_of_json(palpate: Palpate) -> None:
    said = palpate("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", "--progress", "json", "--json")
    events = [json.loads(line) for line in said.err.splitlines()]
    assert [each["event"] for each in events if each["event"] not in LIVE] == [
        "begun", "planned", "point", "point", "ended",
    ]  # fmt: skip
    assert events[0]["run"] == said.object["run"]
    said = palpate("sweep", "loads", "--progress", "yaml")
    assert (said.status, "'yaml' is not one of 'bar', 'json'" in said.err) == (2, True)
