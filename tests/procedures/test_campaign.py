"""A campaign carries out what is due, in the order of need, and goes on wherever it was killed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

import palpate
from palpate.procedures.records.record import Recorder, locked
from tests.campaigns import NIGHTLY
from tests.procedures.conftest import Palpate
from tests.shares import first_of


@pytest.fixture
def file() -> str:
    Path("nightly.toml").write_text(NIGHTLY, encoding="utf-8")
    return "nightly.toml"


def digests(store: str = "runs") -> dict[str, str]:
    runs = [palpate.read(path.parent) for path in Path(store).glob("*/run.record")]
    assert {run.status for run in runs} == {"complete"}
    return {run.procedure: run.digest() for run in runs}


def test_what_is_due_is_done_in_the_order_of_need_and_not_again(palpate: Palpate, file: str) -> None:
    ahead = palpate("campaign", file, "--dry-run", "--json").object
    assert [(step["name"], step["due"]) for step in ahead["steps"]] == [
        ("cell", True),
        ("films", True),
        ("sweep", True),
    ]
    assert ahead["seconds"] == pytest.approx(sum(step["seconds"] for step in ahead["steps"]))
    assert not Path("runs").exists()
    done = palpate("campaign", file, "--json").object
    assert [step["why"] for step in done["steps"]] == [
        "there is none on this bench yet", "cell is done anew", "in each campaign",
    ]  # fmt: skip
    sweep = palpate("runs", "show", done["steps"][2]["run"], "--json").object
    assert sweep["header"]["about"] == {"campaign": "nightly"}
    assert sweep["header"]["calibration"]["source"] == done["steps"][0]["run"].removeprefix("runs/")
    again = palpate("campaign", file, "--json").object
    assert [(step["name"], step["due"]) for step in again["steps"]] == [
        ("cell", False), ("films", False), ("sweep", True),
    ]  # fmt: skip
    assert again["steps"][0]["why"].endswith("is younger than 30 d")
    assert len(list(Path("runs").glob("*/run.record"))) == 4


def test_two_campaigns_that_begin_in_the_same_second_are_two(palpate: Palpate, file: str) -> None:
    """Each second of the coming five minutes has a campaign already."""
    now = datetime.now(UTC)
    for second in range(300):
        taken = Path(f"runs/campaigns/{now + timedelta(seconds=second):%Y%m%dT%H%M%SZ}-nightly")
        taken.mkdir(parents=True)
        taken.joinpath("campaign.json").write_text("this is another campaign", encoding="utf-8")
    done = palpate("campaign", file, "--json").object
    assert done["folder"].endswith("Z-nightly-2")
    assert [step["due"] for step in done["steps"]] == [True] * 3


@pytest.mark.parametrize(
    "cuts", [(7, 30), *(pytest.param(cuts, marks=pytest.mark.slow) for cuts in ((1,), (25, 31, 36, 40, 44)))]
)
def test_killed_anywhere_it_goes_on_and_gives_the_same(
    palpate: Palpate, file: str, on_progress: Callable[[Callable[[int, int, str], None]], None], cuts: tuple[int, ...]
) -> None:
    """The reports of progress are counted over all runs, and at some of them Ctrl-C comes."""
    palpate("campaign", file, "--out", "whole")
    expected = digests()
    Path("runs").rename("first")
    seen = 0

    def cut(_done: int, _total: int, _what: str) -> None:
        nonlocal seen
        seen += 1
        if seen in cuts:
            raise KeyboardInterrupt

    on_progress(cut)
    for number in range(len(cuts)):
        said = palpate("campaign", file, "--out", "cut")
        assert said.status == 130, (number, said.err)
        assert f"go on with: palpate campaign {file} --out cut" in said.err
    assert palpate("campaign", file, "--out", "cut").status == 0
    assert digests() == expected
    assert len(list(Path("runs").glob("*/run.record"))) == 3


def test_on_a_real_bench_the_part_of_a_person_is_told_beforehand_and_how_to_go_on_afterwards(
    lab: str, palpate: Palpate, on_progress: Callable[[Callable[[int, int, str], None]], None]
) -> None:
    Path("real.toml").write_text(NIGHTLY.replace('scene = "noisy_lab"', f'bench = "{lab}"'), encoding="utf-8")
    steps = palpate("campaign", "real.toml", "--dry-run", "--json").object["steps"]
    told = {step["name"]: step["person"] for step in steps}
    assert told["cell"] == "places the weights, confirms what is mounted"
    assert told["sweep"] == "confirms what is mounted"

    def cut(_done: int, _total: int, _what: str) -> None:
        raise KeyboardInterrupt

    on_progress(cut)
    said = palpate("campaign", "real.toml", "--out", "cut", "--assume-mounted")
    assert "this was step cell of the campaign; go on with: palpate campaign real.toml --out cut --assume-mounted" in (
        said.err
    )


@pytest.mark.slow
def test_a_count_of_runs_or_a_drift_makes_a_step_due(palpate: Palpate, file: str) -> None:
    drift = 'drift = {}\nof = "sensitivity_mV_per_N"'

    def cell(rule: str) -> tuple[bool, str]:
        Path(file).write_text(NIGHTLY.replace('due = "30 d"', rule), encoding="utf-8")
        (step,) = (s for s in palpate("campaign", file, "--dry-run", "--json").object["steps"] if s["name"] == "cell")
        return step["due"], step["why"]

    assert palpate("calibrate", "load-cell", "--scene", "noisy_lab", "--out", "runs/first").status == 0
    assert cell("every = 2") == (False, "0 of 2 runs since the last one")
    assert cell(drift.format(0.5)) == (False, "one is stored")
    for number in range(2):
        where = ("--scene", "noisy_lab", "--out", f"runs/{number}")
        assert palpate("sweep", "loads", "--samples", "1", "--loads", "2 N", *where).status == 0
    assert cell("every = 2") == (True, "2 runs since the last one")
    palpate("calibrate", "load-cell", "--scene", "noisy_lab", "--runs", "2", "--out", "runs/second")
    due, why = cell(drift.format(1e-9))
    assert (due, why.startswith("sensitivity_mV_per_N changed by ")) == (True, True)
    assert cell(drift.format(0.5)) == (False, why)


def past(name: str, procedure: str, hours: float, scene: str = "noisy_lab", **summary: float) -> None:
    """A complete run in the store, which began so long ago."""
    began = (datetime.now(UTC) - timedelta(hours=hours)).isoformat()
    header = {"procedure": procedure, "simulated": True, "started": began, "scene": {"name": scene}}
    Recorder.create(Path("runs") / name, header).finish("complete", summary)


def due(palpate: Palpate, file: str, *changes: tuple[str, str]) -> dict[str, tuple[bool, str]]:
    """Whether each step of a changed file is due, and why."""
    text = NIGHTLY
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    Path(file).write_text(text, encoding="utf-8")
    steps = palpate("campaign", file, "--dry-run", "--json").object["steps"]
    return {step["name"]: (step["due"], step["why"]) for step in steps}


def test_an_age_counts_by_the_clock_and_a_run_of_a_time_to_come_proves_nothing(palpate: Palpate, file: str) -> None:
    past("first", "calibrate-load-cell", 29 * 24)
    assert due(palpate, file)["cell"][0] is False
    past("ahead", "calibrate-load-cell", -5)
    (is_due, why) = due(palpate, file)["cell"]
    assert (is_due, "is later than this computer's clock" in why) == (True, True)


def test_runs_of_another_bench_and_those_that_are_not_simulated_do_not_count(palpate: Palpate, file: str) -> None:
    past("other", "calibrate-load-cell", 1, scene="ideal")
    began = {"procedure": "calibrate-load-cell", "simulated": False, "started": datetime.now(UTC).isoformat()}
    Recorder.create(Path("runs/real"), {**began, "bench": 'name = "noisy_lab"'}).finish("complete", {})
    assert due(palpate, file)["cell"] == (True, "there is none on this bench yet")


def test_runs_that_began_with_the_last_one_count_and_a_drift_is_compared_as_it_is_given(
    palpate: Palpate, file: str
) -> None:
    every = ('due = "30 d"', "every = 1")
    now = datetime.now(UTC)
    for name, procedure in (("cell", "calibrate-load-cell"), ("sweep", "sweep-loads")):
        header = {"procedure": procedure, "simulated": True, "started": now.isoformat(), "scene": {"name": "noisy_lab"}}
        Recorder.create(Path("runs") / name, header).finish("complete", {"value": 10.15})
    assert due(palpate, file, every)["cell"] == (True, "1 runs since the last one")
    past("before", "calibrate-load-cell", 1, value=10.0)
    for drift, expected in ((0.014, True), (0.016, False)):
        rule = ('due = "30 d"', f'drift = {drift}\nof = "value"')
        assert due(palpate, file, rule)["cell"] == (expected, "value changed by 1.5 % between the last two")


def test_only_what_a_step_needs_makes_it_due(palpate: Palpate, file: str) -> None:
    for name, procedure, hours in (
        ("cell", "calibrate-load-cell", 31 * 24), ("films", "calibrate-films", 1), ("sweep", "sweep-loads", 1),
    ):  # fmt: skip
        past(name, procedure, hours)
    daily = ('needs = ["films"]', 'needs = ["films"]\ndue = "1 d"')
    alone = ('needs = ["cell"]', "needs = []")
    assert {name: each[0] for name, each in due(palpate, file, daily, alone).items()} == {
        "films": False, "cell": True, "sweep": False,
    }  # fmt: skip
    assert all(each[0] for each in due(palpate, file, daily).values())


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('needs = ["cell"]', 'needs = ["sweep"]', "sweep needs films needs sweep, so none of them can be the first"),
        ('needs = ["cell"]', 'needs = ["sell"]', "unknown step 'sell' (did you mean 'cell'?)"),
        ('"calibrate-films"', '"calibrate-film"', "step.films: unknown procedure 'calibrate-film'"),
        ("samples =", "sample =", "unknown setting of sweep-loads 'sample'"),
        ('"2 N", "3 N"', '"2 kg", "3 N"', "step.sweep: --loads"),
        ('due = "7 d"', 'due = "7 moons"', "'7 moons' is no age; write hours, days or weeks"),
        ('due = "7 d"', "drift = 0.1", "drift and of belong together"),
        ('due = "7 d"', 'run = "rm -r /"', "run"),
        ("step.films", 'step."../films"', "'../films' is no name"),
        ('scene = "noisy_lab"', 'scene = "noisy_lab"\nbench = "lab.toml"', "--scene"),
        ('"1,2"', '"1,99"', "unknown sample '99'"),
        ('"0.5 s" }', "0.5 }", "nightly.toml: step.sweep.settings.dwell: 0.5 is no setting; write it in quotes"),
        ('["2 N", "3 N"]', "[2.5, 3]", "nightly.toml: step.sweep.settings.loads: [2.5, 3] is no setting"),
    ],
)
def test_a_campaign_that_cannot_be_is_refused_before_anything_is_begun(
    palpate: Palpate, file: str, old: str, new: str, told: str
) -> None:
    Path(file).write_text(NIGHTLY.replace(old, new), encoding="utf-8")
    said = palpate("campaign", file)
    assert (said.status, told in said.complaint) == (2, True), said.err
    assert not Path("runs").exists()


def test_a_state_of_another_file_or_one_that_is_no_state_is_refused(palpate: Palpate, file: str) -> None:
    palpate("campaign", file, "--out", "state")
    Path(file).write_text(NIGHTLY.replace("0.5 s", "0.6 s"), encoding="utf-8")
    said = palpate("campaign", file, "--out", "state")
    assert (said.status, "state holds a campaign of another file; give another --out" in said.err) == (2, True)
    Path(file).write_text(NIGHTLY, encoding="utf-8")
    state = json.loads(Path("state/campaign.json").read_text())
    state["steps"]["cell"]["run"] = "../../elsewhere"
    Path("state/campaign.json").write_text(json.dumps(state))
    said = palpate("campaign", file, "--out", "state")
    assert (said.status, "'../../elsewhere' is no folder of the store" in said.err) == (1, True), said.err
    Path("state/campaign.json").write_text("[]")
    said = palpate("campaign", file, "--out", "state")
    assert (said.status, "campaign.json cannot be read" in said.err) == (1, True), said.err


def test_a_campaign_belongs_to_the_store_of_its_runs_and_to_one_process(
    palpate: Palpate, file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    palpate("campaign", file, "--out", "state")
    ahead = palpate("campaign", file, "--out", "state", "--dry-run", "--json").object
    assert (ahead["seconds"], [step["due"] for step in ahead["steps"]]) == (0, [False] * 3)
    assert ahead["steps"][2]["why"].endswith("-nightly-sweep is complete")
    with locked(Path("state").absolute()):
        said = palpate("campaign", file, "--out", "state")
    assert (said.status, "is being written by another process" in said.err) == (2, True), said.err
    shutil.rmtree(Path("runs") / ahead["steps"][2]["why"].split()[0])
    said = palpate("campaign", file, "--out", "state")
    assert (said.status, "the run of step sweep is gone" in said.err) == (1, True), said.err
    monkeypatch.setenv("PALPATE_STORE", "elsewhere")
    said = palpate("campaign", file, "--out", "state")
    assert (said.status, "was begun with the runs in" in said.err) == (2, True), said.err


@pytest.mark.parametrize(
    ("limit", "status", "verdict"),
    first_of(
        [
            ('["force ratio of sample 1"]\nhigh = 0.1', 3, "fail"),
            ('["force ratio of sample 1"]\nhigh = 1.0', 0, "pass"),
            ('[load_N]\nhigh = "9 N"', 4, "undecided"),
        ]
    ),
)
def test_what_needs_a_step_that_does_not_pass_its_limits_is_left_out(
    palpate: Palpate, file: str, limit: str, status: int, verdict: str
) -> None:
    Path("limits.toml").write_text(limit, encoding="utf-8")
    one = '[step.{}]\nprocedure = "sweep-loads"\nneeds = ["{}"]\nsettings = {{ samples = "1", loads = "2 N" }}\n'
    after = one.format("after", "sweep") + one.format("last", "after")
    limits = '[step.sweep]\nlimits = "limits.toml"\nprocedure'
    Path(file).write_text(NIGHTLY.replace("[step.sweep]\nprocedure", limits) + after, encoding="utf-8")
    said = palpate("campaign", file, "--json", "--out", "one")
    assert said.status == status, said.err
    rows = {row["name"]: row for row in json.loads(said.out)["steps"]}
    assert rows["sweep"]["verdict"] == verdict
    assert [rows[name]["due"] for name in ("after", "last")] == [status == 0] * 2
    if status:
        assert [rows[name]["why"] for name in ("after", "last")] == ["sweep did not pass", "after did not pass"]
    said = palpate("campaign", file, "--out", "one")
    assert (said.status, verdict in said.out) == (status, True)


@pytest.mark.parametrize(
    ("limits", "told"),
    [('[force_ratio]\nlow = "3 N"', "plain number"), ("[force_ratioo]\nlow = 0.3", "unknown quantity 'force_ratioo'")],
)
def test_limits_that_a_step_cannot_have_are_refused_before_anything_is_begun(
    palpate: Palpate, file: str, limits: str, told: str
) -> None:
    Path("limits.toml").write_text(limits, encoding="utf-8")
    Path(file).write_text(NIGHTLY.replace('needs = ["films"]', 'needs = ["films"]\nlimits = "limits.toml"'))
    for arguments in ((), ("--dry-run",)):
        said = palpate("campaign", file, *arguments)
        assert (said.status, told in said.err, Path("runs").exists()) == (2, True, False), said.err


def test_limits_are_read_before_anything_is_begun(palpate: Palpate, file: str) -> None:
    Path(file).write_text(NIGHTLY.replace('due = "7 d"', 'limits = "nothing.toml"'), encoding="utf-8")
    said = palpate("campaign", file)
    assert (said.status, "nothing.toml" in said.err, Path("runs").exists()) == (2, True, False)
