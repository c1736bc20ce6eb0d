"""A campaign carries out what is due, in the order of need, and goes on wherever it was killed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

import palpate
from palpate.procedures.console.terminal import Progress
from palpate.procedures.records.record import Recorder, locked
from tests.procedures.conftest import Palpate, interrupt_at, said_once
from tests.runs import NIGHTLY
from tests.shares import first_of

STEPS = ("cell", "films", "sweep")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The store of a whole campaign, and what its command told."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "nightly.toml").write_text(NIGHTLY, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", lambda _figure, path, **_: Path(path).touch())
        return folder / "runs", said_once(folder, "campaign", "nightly.toml")


@pytest.fixture
def file() -> str:
    Path("nightly.toml").write_text(NIGHTLY, encoding="utf-8")
    return "nightly.toml"


def digests(store: Path = Path("runs")) -> dict[str, str]:
    runs = [palpate.read(path.parent) for path in store.glob("*/run.record")]
    assert {run.status for run in runs} == {"complete"}
    return {run.procedure: run.digest() for run in runs}


def test_what_is_due_is_done_in_the_order_of_need_and_not_again(
    palpate: Palpate, file: str, whole: tuple[Path, dict[str, Any]]
) -> None:
    ahead = palpate("campaign", file, "--dry-run", "--json").object
    assert [(step["name"], step["due"]) for step in ahead["steps"]] == [(name, True) for name in STEPS]
    assert ahead["seconds"] == pytest.approx(sum(step["seconds"] for step in ahead["steps"]))
    assert not Path("runs").exists()
    store, done = whole
    shutil.copytree(store, "runs")
    assert [step["why"] for step in done["steps"]] == [
        "there is none on this bench yet", "cell is done anew", "in each campaign",
    ]  # fmt: skip
    header = palpate("runs", "show", done["steps"][2]["run"], "--json").object["header"]
    assert header["about"] == {"campaign": "nightly"}
    assert header["calibration"]["source"] == done["steps"][0]["run"].removeprefix("runs/")
    for second in range(300):  # each second of the coming five minutes has a campaign already
        taken = Path(f"runs/campaigns/{datetime.now(UTC) + timedelta(seconds=second):%Y%m%dT%H%M%SZ}-nightly")
        taken.mkdir(parents=True, exist_ok=True)
        taken.joinpath("campaign.json").write_text("this is another campaign", encoding="utf-8")
    again = palpate("campaign", file, "--json").object
    assert again["folder"].endswith("Z-nightly-2")
    assert [(step["name"], step["due"]) for step in again["steps"]] == list(
        zip(STEPS, (False, False, True), strict=True)
    )
    assert again["steps"][0]["why"].endswith("is younger than 30 d")
    assert len(list(Path("runs").glob("*/run.record"))) == 4


@pytest.mark.parametrize("cuts", [(7, 30), pytest.param((1, 31, 36, 40), marks=pytest.mark.slow)])
def test_killed_anywhere_it_goes_on_and_gives_the_same(
    palpate: Palpate,
    file: str,
    on_progress: Callable[[Progress], None],
    whole: tuple[Path, dict[str, Any]],
    cuts: tuple[int, ...],
) -> None:
    """The reports of progress are counted over all runs, and at some of them Ctrl-C comes."""
    reports = count(1)

    def cut(_done: int, _total: int, _what: str) -> None:
        if next(reports) in cuts:
            raise KeyboardInterrupt

    on_progress(cut)
    for _ in cuts:
        said = palpate("campaign", file, "--out", "cut")
        assert (said.status, f"go on with: palpate campaign {file} --out cut" in said.err) == (130, True), said.err
    assert (palpate("campaign", file, "--out", "cut").status, digests()) == (0, digests(whole[0]))
    assert len(list(Path("runs").glob("*/run.record"))) == 3


def test_on_a_real_bench_the_part_of_a_person_is_told_beforehand_and_how_to_go_on_afterwards(
    lab: str, palpate: Palpate, on_progress: Callable[[Progress], None]
) -> None:
    Path("real.toml").write_text(NIGHTLY.replace('scene = "noisy_lab"', f'bench = "{lab}"'), encoding="utf-8")
    steps = palpate("campaign", "real.toml", "--dry-run", "--json").object["steps"]
    told = {step["name"]: step["person"] for step in steps}
    assert (told["cell"], told["sweep"]) == ("places the weights, confirms what is mounted", "confirms what is mounted")
    on_progress(interrupt_at(0))
    said = palpate("campaign", "real.toml", "--out", "cut", "--assume-mounted").err
    assert (
        "this was step cell of the campaign; go on with: palpate campaign real.toml --out cut --assume-mounted" in said
    )


def past(
    name: str, procedure: str, hours: float, summary: Mapping[str, float] = MappingProxyType({}), **header: Any
) -> None:
    """A complete run in the store, which began so long ago."""
    began = (datetime.now(UTC) - timedelta(hours=hours)).isoformat()
    given = {"procedure": procedure, "simulated": True, "started": began, "scene": {"name": "noisy_lab"}, **header}
    Recorder.create(Path("runs") / name, given).finish("complete", summary)


def due(palpate: Palpate, file: str, *changes: tuple[str, str]) -> dict[str, tuple[bool, str]]:
    """Whether each step of a changed file is due, and why."""
    text = NIGHTLY
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    Path(file).write_text(text, encoding="utf-8")
    steps = palpate("campaign", file, "--dry-run", "--json").object["steps"]
    return {step["name"]: (step["due"], step["why"]) for step in steps}


def test_an_age_counts_by_the_clock_and_neither_a_run_of_another_bench_nor_of_a_time_to_come_does(
    palpate: Palpate, file: str
) -> None:
    past("other", "calibrate-load-cell", 1, scene={"name": "ideal"})
    past("real", "calibrate-load-cell", 0, simulated=False, bench='name = "noisy_lab"', scene=None)
    assert due(palpate, file)["cell"] == (True, "there is none on this bench yet")
    past("first", "calibrate-load-cell", 29 * 24)
    assert due(palpate, file)["cell"][0] is False
    past("ahead", "calibrate-load-cell", -5)
    (is_due, why) = due(palpate, file)["cell"]
    assert (is_due, "is later than this computer's clock" in why) == (True, True)


def test_runs_that_began_with_the_last_one_count_and_a_drift_is_compared_as_it_is_given(
    palpate: Palpate, file: str
) -> None:
    now = datetime.now(UTC).isoformat()
    past("cell", "calibrate-load-cell", 0, {"value": 10.15}, started=now)
    for runs, told in ((0, (False, "0 of 2 runs since the last one")), (1, (True, "1 runs since the last one"))):
        assert due(palpate, file, ('due = "30 d"', f"every = {2 - runs}"))["cell"] == told
        past(f"sweep-{runs}", "sweep-loads", 0, started=now)
    assert drifted(palpate, file, 0.014) == (False, "one is stored")
    past("before", "calibrate-load-cell", 1, {"value": 10.0})
    told = "value changed by 1.5 % between the last two"
    assert [drifted(palpate, file, drift) for drift in (0.014, 0.016)] == [(True, told), (False, told)]


def drifted(palpate: Palpate, file: str, drift: float) -> tuple[bool, str]:
    return due(palpate, file, ('due = "30 d"', f'drift = {drift}\nof = "value"'))["cell"]


def test_only_what_a_step_needs_makes_it_due(palpate: Palpate, file: str) -> None:
    procedures = {"calibrate-load-cell": 31 * 24, "calibrate-films": 1, "sweep-loads": 1}
    for procedure, hours in procedures.items():
        past(procedure, procedure, hours)
    daily = ('needs = ["films"]', 'needs = ["films"]\ndue = "1 d"')
    alone = due(palpate, file, daily, ('needs = ["cell"]', "needs = []"))
    assert {name: each[0] for name, each in alone.items()} == {"films": False, "cell": True, "sweep": False}
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
        ('due = "7 d"', 'limits = "nothing.toml"', "nothing.toml"),
        ('needs = ["films"]', 'needs = ["films"]\nlimits = "unit.toml"', "plain number"),
        ('needs = ["films"]', 'needs = ["films"]\nlimits = "name.toml"', "unknown quantity 'force_ratioo'"),
    ],
)
def test_a_campaign_that_cannot_be_is_refused_before_anything_is_begun(
    palpate: Palpate, file: str, old: str, new: str, told: str
) -> None:
    Path(file).write_text(NIGHTLY.replace(old, new), encoding="utf-8")
    Path("unit.toml").write_text('[force_ratio]\nlow = "3 N"', encoding="utf-8")
    Path("name.toml").write_text("[force_ratioo]\nlow = 0.3", encoding="utf-8")
    for rehearsal in ((), ("--dry-run",)):
        assert told in palpate("campaign", file, *rehearsal).refusal
    assert not Path("runs").exists()


def test_a_campaign_belongs_to_its_file_the_store_of_its_runs_and_one_process(
    palpate: Palpate, file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, begin = Path("state/campaign.json"), ("campaign", file, "--out", "state")
    palpate(*begin)
    ahead = palpate(*begin, "--dry-run", "--json").object
    assert (ahead["seconds"], [step["due"] for step in ahead["steps"]]) == (0, [False] * 3)
    assert ahead["steps"][2]["why"].endswith("-nightly-sweep is complete")
    with locked(Path("state").absolute()):
        assert "is being written by another process" in palpate(*begin).refusal
    Path(file).write_text(NIGHTLY.replace("0.5 s", "0.6 s"), encoding="utf-8")
    assert "state holds a campaign of another file; give another --out" in palpate(*begin).refusal
    Path(file).write_text(NIGHTLY, encoding="utf-8")
    with monkeypatch.context() as patch:
        patch.setenv("PALPATE_STORE", "elsewhere")
        assert "was begun with the runs in" in palpate(*begin).refusal
    shutil.rmtree(Path("runs") / ahead["steps"][2]["why"].split()[0])
    assert "the run of step sweep is gone" in palpate(*begin).complaint
    stored = json.loads(state.read_text())
    stored["steps"]["cell"]["run"] = "../../elsewhere"
    for text, told in (
        (json.dumps(stored), "'../../elsewhere' is no folder of the store"),
        ("[]", "campaign.json cannot be read"),
    ):
        state.write_text(text)
        assert told in palpate(*begin).complaint


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
    sweep = NIGHTLY.partition("[step.films]")[0].replace('needs = ["films"]', 'limits = "limits.toml"')
    Path(file).write_text(sweep + after, encoding="utf-8")
    said = palpate("campaign", file, "--json", "--out", "one")
    rows = {row["name"]: row for row in json.loads(said.out)["steps"]}
    assert (said.status, rows["sweep"]["verdict"]) == (status, verdict)
    if status:
        told = [(rows[name]["due"], rows[name]["why"]) for name in ("after", "last")]
        assert told == [(False, "sweep did not pass"), (False, "after did not pass")]
    said = palpate("campaign", file, "--out", "one")
    assert (said.status, verdict in said.out) == (status, True)
    assert said.out.splitlines()[0] == "SIMULATED Campaign nightly"


def test_the_settings_of_a_step_are_named_as_the_options_of_its_command(palpate: Palpate) -> None:
    step = 'name = "one"\n[step.stiff]\nprocedure = "measure-modulus"\nsettings = {{ {} = "4", time = "2 min" }}\n'
    for name in ("sample", "object"):
        Path(f"{name}.toml").write_text(step.format(name), encoding="utf-8")
    assert palpate("campaign", "sample.toml", "--dry-run", "--json").object["steps"][0]["due"] is True
    assert "unknown setting of measure-modulus 'object'" in palpate("campaign", "object.toml", "--dry-run").err
