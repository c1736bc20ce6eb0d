"""Each run says who measured what, in the lab's own keys, and is found again in a list by the index of its store."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

import palpate
from palpate.instrument.errors import RecordError
from palpate.procedures.records.record import Recorder
from palpate.testing import steps
from tests.procedures.conftest import HEADER, Palpate, interrupt_at
from tests.runs import flip, made, rehash

SWEEP = palpate.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.5)
COMMAND = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.5 s")
SCHEMA = """
[operator]
ask = "Who measures?"
required = true

[batch]
values = ["B6", "B7"]

[ticket]
default = "none"
"""


@pytest.fixture
def store(palpate: Palpate) -> Path:
    folder = Path("runs")
    folder.mkdir()
    return folder


def test_it_is_said_once_for_a_bench_and_stands_in_each_of_its_runs(store: Path) -> None:
    about = {"operator": "AB", "object": "<script>", "note": "=1+1"}
    with palpate.open_bench(about=about) as bench:
        done = [palpate.run(SWEEP, bench) for _ in range(2)]
    with palpate.open_bench() as bench:
        plain = palpate.run(SWEEP, bench)
    assert [each.run.header.get("about") for each in (*done, plain)] == [about, about, None]
    assert (done[0].outcome["about"], plain.run.digest()) == (about, done[0].run.digest())


def test_a_command_takes_it_and_shows_it(store: Path, palpate: Palpate) -> None:
    said = palpate(*COMMAND, "--about", "operator = AB", "--about", "batch=B7", "--out", "run")
    assert "about          operator AB, batch B7" in said.out.splitlines(), said.err
    assert "about        batch B7, operator AB" in palpate("runs", "show", "run").out.splitlines()
    palpate("calibrate", "load-cell", "--about", "operator = <b>", "--out", "cell")
    for file, told in (("md", "| operator | &lt;b&gt; |"), ("html", "<td>&lt;b&gt;</td>")):
        assert told in Path(f"cell/certificate.{file}").read_text(encoding="utf-8")


def test_the_labs_own_file_asks_and_adds_and_knows_all_keys(store: Path, palpate: Palpate) -> None:
    (store / "about.toml").write_text(SCHEMA, encoding="utf-8")
    said = palpate(*COMMAND, "--about", "batch = B6", "--about", "operator = AB", "--json")
    assert json.loads(said.out)["about"] == {"operator": "AB", "batch": "B6", "ticket": "none"}


def test_a_resumed_run_keeps_what_it_said_although_the_lab_asks_for_more_now(store: Path) -> None:
    sweep = palpate.LoadSweep(samples=("1",), loads=(2.0, 3.0), dwell=0.5)
    with pytest.raises(KeyboardInterrupt), palpate.open_bench(about={"operator": "AB"}) as bench:
        palpate.run(sweep, bench, out=store / "cut", listeners=[steps(interrupt_at(1))])
    (store / "about.toml").write_text(SCHEMA.replace("batch", "lot"), encoding="utf-8")
    done = palpate.resume("cut")
    assert done.run.header["about"] == done.outcome["about"] == {"operator": "AB"}


@pytest.mark.parametrize(
    ("schema", "given", "told"),
    [
        (SCHEMA, (), "asks each run for operator, which is not told; give --about 'operator = …'"),
        (SCHEMA, ("operator = AB", "bach = B6"), "unknown key of"),
        (SCHEMA, ("operator = AB", "batch = B8"), "unknown batch 'B8'; valid: B6, B7"),
        ("", ("operator",), "give a key and a value, such as --about 'operator = AB'"),
        ("", ("operator = ",), "operator: '' is no value"),
        ("", ("operator = A\nB",), "no value; give 1 to 200 printable characters in one line"),
        ("", ("Operator = AB",), "'Operator' is no key; give small letters, digits and _"),
        ("", ("scene = dark",), "palpate says scene of each run itself; take another key"),
        ("", ("operator = A", "operator = B"), "operator is given twice, as 'A' and 'B'; give it once"),
        ("operator = 1", ("operator = AB",), "operator: is no table; write [operator] on a line of its own"),
        ('[batch]\ndefault = "B"\nvalues = ["B6"]', (), "about.toml 'B' (did you mean 'B6'?); valid: B6"),
        ("[batch]\nasked = true", (), "asked"),
        ("[batch", (), "about.toml"),
    ],
)
def test_what_a_lab_does_not_want_is_refused_before_a_bench_is_opened(
    store: Path, palpate: Palpate, schema: str, given: tuple[str, ...], told: str
) -> None:
    if schema:
        (store / "about.toml").write_text(schema, encoding="utf-8")
    said = palpate(*COMMAND, *(part for each in given for part in ("--about", each)), "--out", "run")
    assert (said.status, told in said.err) == (2, True), said.err
    assert not Path("run").exists()


@pytest.fixture
def runs(store: Path) -> None:
    """A store with runs that say what they are."""
    for number, (procedure, batch, points) in enumerate(
        (("sweep-loads", "B6", 1), ("sweep-loads", "B7", 1), ("sweep-loads", "B7", 2), ("calibrate-load-cell", "", 3))
    ):
        about = {"about": {"batch": batch}} if batch else {}
        made(store / str(number), {**HEADER, "procedure": procedure, "seed": 1, **about}, [({"x": 1.0}, {})] * points)


@pytest.mark.usefixtures("runs")
@pytest.mark.parametrize(
    ("conditions", "found"),
    [
        (("batch = B7",), ["1", "2"]),
        (("batch != B7",), ["0"]),
        (("procedure = calibrate-load-cell", "points >= 2"), ["3"]),
        (("points > 1000",), []),
        (("simulated = true", "batch=B6"), ["0"]),
    ],
)
def test_runs_are_found_again_by_what_they_say_and_what_they_are(
    palpate: Palpate, conditions: tuple[str, ...], found: list[str]
) -> None:
    given = [part for each in conditions for part in ("--where", each)]
    listed = palpate("runs", "list", "--json", *given).object["runs"]
    assert sorted(Path(run["run"]).name for run in listed) == found


@pytest.mark.usefixtures("runs")
def test_a_condition_that_nothing_fits_says_so_and_one_that_is_none_is_refused(palpate: Palpate) -> None:
    assert palpate("runs", "list", "--where", "seed = 99").out.splitlines() == ["no run in runs fits"]
    for condition, told in (
        ("bach = B7", "unknown value of these runs 'bach' (did you mean 'batch'?)"),
        ("batch", "'batch' is no condition; give a name, one of"),
        ("points > x", "points is a number in these runs, and 'x' is none"),
    ):
        assert told in palpate("runs", "list", "--where", condition).refusal


def test_all_runs_of_a_store_are_one_table(store: Path) -> None:
    for name, options in (("one", {"about": {"batch": "B7"}}), ("other", {"scene": "noisy_lab", "seed": 4})):
        with palpate.open_bench(**options) as bench:  # type: ignore[arg-type]
            palpate.run(SWEEP, bench, out=store / name)
    (store / "damaged").mkdir()
    (store / "damaged" / "run.record").write_bytes(b"nothing")
    table = palpate.runs().set_index("run")
    assert table.loc["one", ["procedure", "status", "points", "scene", "batch"]].tolist() == [
        "sweep-loads", "complete", 1, "thesis_single", "B7",
    ]  # fmt: skip
    assert (table.loc["other", "seed"], table.loc["damaged", "status"]) == (4, "damaged")
    assert list(table.loc["one", "settings.loads"]) == [2.0]
    assert palpate.runs(where=["scene = noisy_lab"])["run"].tolist() == ["other"]
    assert len(palpate.runs(store / "nothing")) == 0


# --- the index of a store: it says what reading the runs says ------------------------------------------


STORE, INDEX = Path("runs"), Path("runs/runs.index")
COUNT = 30
LONG_AGO = 1_700_000_000  # s since 1970
Listed = Callable[[], list[dict[str, Any]]]


def aged(folder: Path) -> None:
    """The files of a run as if they had been written long ago."""
    for path in folder.iterdir():
        os.utime(path, (LONG_AGO, LONG_AGO))


@pytest.fixture
def listed(palpate: Palpate) -> Listed:
    """Lists the runs of a store of thirty, written long ago."""
    recorder = Recorder.create(
        STORE / "0", {"procedure": "sweep-loads", "simulated": True, "started": "2025-03-14T15:09:26Z"}
    )
    recorder.point({"load_N": 1.5}, {}, 1)
    recorder.finish("complete", {})
    for number in range(1, COUNT):
        shutil.copytree(STORE / "0", STORE / str(number))
    for folder in STORE.iterdir():
        aged(folder)

    def by_command() -> list[dict[str, Any]]:
        runs: list[dict[str, Any]] = palpate("runs", "list", "--json").object["runs"]
        return runs

    return by_command


def anew(by_command: Listed) -> list[dict[str, Any]]:
    """The list without an index."""
    INDEX.unlink()
    return by_command()


def test_runs_that_have_not_changed_are_listed_without_being_read(
    listed: Listed, palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, table = listed(), palpate("runs", "list").out
    assert [(run["status"], run["points"], run["procedure"]) for run in before] == [
        ("complete", 1, "sweep-loads")
    ] * COUNT
    refused = Mock(side_effect=RecordError("it was read"))
    monkeypatch.setattr("palpate.procedures.records.run.Run.open", refused)
    assert (listed(), palpate("runs", "list").out) == (before, table)
    INDEX.unlink()
    assert {run["status"] for run in listed()} == {"damaged"}


def test_a_run_that_was_changed_removed_or_added_is_listed_as_it_is_now(listed: Listed) -> None:
    listed()
    rehash(STORE / "3", status="stopped")
    aged(STORE / "3")
    for name in ("4", "6"):
        shutil.rmtree(STORE / name)
    for name, other in (("5", "new"), ("3", "6")):
        shutil.copytree(STORE / name, STORE / other)
    now = {Path(run["run"]).name: run["status"] for run in listed()}
    assert (now["3"], now["6"], now["new"], now["5"]) == ("stopped", "stopped", "complete", "complete")
    assert "4" not in now and len(now) == COUNT
    assert listed() == anew(listed)


def test_a_run_that_was_changed_without_another_size_or_time_of_writing_is_read(listed: Listed) -> None:
    listed()
    flip(STORE / "3" / "run.record")
    aged(STORE / "3")
    assert [(Path(run["run"]).name, run["status"]) for run in listed() if run["fault"]] == [("3", "damaged")]
    assert listed() == anew(listed)


def test_runs_that_were_written_a_moment_ago_or_few_are_read_again_without_an_index(listed: Listed) -> None:
    """Each could be changed once more, and its files have the same times."""
    for path in STORE.glob("*/*"):
        path.touch()
    assert (len(listed()), INDEX.exists()) == (COUNT, False)
    for folder in [*STORE.iterdir()][5:]:
        shutil.rmtree(folder)
    for folder in STORE.iterdir():
        aged(folder)
    assert (len(listed()), INDEX.exists()) == (5, False)


def in_its_place(make: Callable[[Path], None]) -> Callable[[Path], None]:
    def made(index: Path) -> None:
        index.unlink()
        make(index)

    return made


DAMAGES: dict[str, Callable[[Path], object]] = {
    "lost": Path.unlink,
    "cut": lambda index: index.write_bytes(index.read_bytes()[:-1]),
    "another status": lambda index: index.write_bytes(index.read_bytes().replace(b'"complete"', b'"failed"')),
    "another version": lambda index: index.write_bytes(index.read_bytes().replace(b"runs 1", b"runs 9", 1)),
    "no text": lambda index: index.write_bytes(b"\xff\n{}"),
    "a folder, so that none can be written": in_its_place(os.mkdir),
    "a pipe": in_its_place(os.mkfifo),
    "a draft of a killed writer beside it": lambda index: (index.parent / ".runs.index.1.draft").write_bytes(b"{"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_whatever_became_of_the_index_the_runs_are_listed_as_they_are(damage: str, listed: Listed) -> None:
    before = listed()
    assert INDEX.is_file()
    DAMAGES[damage](INDEX)
    assert [listed(), listed()] == [before, before]


def test_the_index_is_the_old_or_the_new_one_when_its_writer_is_killed(
    listed: Listed, monkeypatch: pytest.MonkeyPatch, palpate: Palpate
) -> None:
    before, old = listed(), INDEX.read_bytes()
    for number in range(COUNT):
        aged(shutil.copytree(STORE / "0", STORE / f"more-{number}"))
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", Mock(side_effect=KeyboardInterrupt))
        assert palpate("runs", "list").status == 130
    assert INDEX.read_bytes() == old
    after = listed()
    assert (len(after), [run for run in after if "more" not in run["run"]]) == (2 * COUNT, before)
    assert INDEX.read_bytes() != old
