"""A result is judged by a file of limits: by each procedure's command, `palpate judge`, and `palpate.judge`."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any
from xml.etree import ElementTree

import pytest

import palpate
from palpate.extend import Column, SimpleResult
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.engine.catalogue import SHIPPED
from palpate.procedures.showing.junit import write_junit
from palpate.testing import steps
from tests.procedures.conftest import Palpate, interrupt_at

SWEEP = palpate.LoadSweep(samples=("1", "2"), loads=(2.0, 3.0), dwell=0.2)
COMMAND = ("sweep", "loads", "--samples", "1,2", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--quiet")
RATIO = "force ratio of sample 1"


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> palpate.Finished[Any]:
    with palpate.open_bench(scene="noisy_lab", seed=4) as bench:
        return palpate.run(SWEEP, bench, out=tmp_path_factory.mktemp("swept") / "run")


def limits_file(text: str, name: str = "limits.toml") -> str:
    Path(name).write_text(text, encoding="utf-8")
    return name


def around(done: palpate.Finished[Any], low: float, high: float) -> dict[str, Any]:
    """Limits of the first mean ratio, in its standard uncertainties from it."""
    budget = done.result.budgets[0]
    return {budget.quantity: {"low": budget.value + low * budget.u, "high": budget.value + high * budget.u}}


# --- what is judged ------------------------------------------------------------------------------------


def test_a_finished_run_its_result_and_the_stored_run_have_the_same_verdicts(
    swept: palpate.Finished[Any], tmp_path: Path
) -> None:
    file = tmp_path / "limits.toml"
    file.write_text(f'["{RATIO}"]\nlow = 0.2\nhigh = "31 %"\n[load_measured_N]\nhigh = "3.01 N"\n', encoding="utf-8")
    found = palpate.judge(swept, str(file))
    assert [each.quantity for each in found.verdicts] == [RATIO, "load_measured_N"]
    assert found == palpate.judge(swept.result, file) == palpate.judge(swept.run, file)
    assert found == palpate.judge(
        palpate.read(swept.folder), {RATIO: {"low": 0.2, "high": "31 %"}, "load_measured_N": {"high": "3.01 N"}}
    )


@pytest.mark.parametrize(
    ("low", "high", "outcome", "status"),
    [(-9, 9, "pass", 0), (1, 9, "undecided", 4), (-9, 1, "undecided", 4), (9, 19, "fail", 3)],
)
def test_pass_fail_and_undecided_have_an_exit_status_each(
    swept: palpate.Finished[Any], palpate: Palpate, low: float, high: float, outcome: str, status: int
) -> None:
    ((name, limits),) = around(swept, low, high).items()
    text = "".join(f"{key} = {value!r}\n" for key, value in limits.items())
    said = palpate("judge", str(swept.folder), limits_file(f'["{name}"]\n{text}'), "--json")
    found = json.loads(said.out)
    assert (said.status, said.err) == (status, "")
    assert (found["verdict"], found["verdicts"][0]["outcome"]) == (outcome, outcome)
    assert (found["run"], found["simulated"], found["procedure"]) == (str(swept.folder), True, "sweep-loads")


def test_one_that_fails_outweighs_those_that_are_undecided_as_of_a_value_without_uncertainty(
    swept: palpate.Finished[Any],
) -> None:
    first, second = (budget.quantity for budget in swept.result.budgets)
    found = palpate.judge(swept, around(swept, -9, 1) | {second: {"low": 0.9}, "load_N": {"high": "9 N"}})
    assert {each.quantity: each.outcome for each in found.verdicts} == {
        first: "undecided", second: "fail", "load_N": "undecided",
    }  # fmt: skip
    assert (found.status, found.verdicts[2].u) == (3, None)
    assert "has no standard uncertainty" in found.verdicts[2].reason


def test_an_undecided_limit_says_which_uncertainty_would_decide_it(swept: palpate.Finished[Any]) -> None:
    (verdict,) = palpate.judge(swept, around(swept, -9, 1)).verdicts
    assert 0 < (verdict.deciding_u or 0) < (verdict.u or 0)
    for told in ("within the guard band of", "in the place of", "it would pass"):
        assert told in verdict.reason


def test_a_stated_prior_decides_and_is_printed(swept: palpate.Finished[Any], palpate: Palpate) -> None:
    budget = swept.result.budgets[0]
    bare = f'["{RATIO}"]\nhigh = {budget.value + budget.u!r}\n'
    sure = f"{bare}prior = {{ mean = {budget.value - 5 * budget.u!r}, sd = {budget.u!r} }}\n"
    for text, status, told in ((bare, 4, " none "), (sure, 0, " normal 0.")):
        said = palpate("judge", str(swept.folder), limits_file(text))
        assert (said.status, told in said.out) == (status, True)


def test_a_column_is_judged_at_each_valid_point_and_the_worst_is_told(swept: palpate.Finished[Any]) -> None:
    points = swept.result.points
    most = max(range(4), key=lambda i: points[i].load_measured_N)
    (verdict,) = palpate.judge(swept, {"load_measured_N": {"high": "2.5 N"}}).verdicts
    assert (verdict.point, verdict.values, verdict.outcome) == (most + 1, 4, "fail")
    assert (verdict.value, verdict.u) == (points[most].load_measured_N, points[most].load_measured_u)


@dataclass(frozen=True, slots=True)
class Row:
    film: Annotated[str, Column("name")]
    gain: Annotated[float, Column("gain", "V/N", u="gain_u")]
    gain_u: float


@dataclass(frozen=True, slots=True)
class Point:
    level: Annotated[float | None, Column("level", "mm", u="level_u")]
    level_u: float | None
    noise: Annotated[tuple[float, ...], Column("noise", "V", u="noise_u")]
    noise_u: tuple[float, ...]
    rows: Annotated[tuple[Row, ...], Column(each="film")]
    valid: bool = True
    flags: tuple[str, ...] = ()


def point(level: float | None, *, valid: bool = True) -> Point:
    return Point(level, 0.01, (1.0, 5.0), (0.1, 0.1), (Row("a", 1.0, 0.1), Row("b", 3.0, 0.1)), valid)


def judged(points: list[Point], name: str, *, budgets: tuple[Budget, ...] = (), **limits: object) -> Any:
    (verdict,) = palpate.judge(SimpleResult(points, budgets=budgets), {name: limits}).verdicts
    return verdict


def test_points_that_are_not_valid_are_left_out_and_that_is_said() -> None:
    verdict = judged([point(1.0), point(9.0, valid=False)], "level", high="2 mm")
    assert (verdict.outcome, verdict.values, "without 1 point that" in verdict.reason) == ("pass", 1, True)


@pytest.mark.parametrize(
    "points", [[point(1.0, valid=False)], [point(1.0), point(None)], [point(1.0), point(math.nan)]]
)
def test_a_value_that_is_missing_is_undecided(points: list[Point]) -> None:
    verdict = judged(points, "level", high="2 mm")
    assert (verdict.outcome, verdict.value) == ("undecided", None)
    assert "there is no valid value" in verdict.reason


def test_each_value_of_a_list_and_of_rows_is_judged() -> None:
    noise, gain = judged([point(1.0)], "noise", high="4 V"), judged([point(1.0)], "rows.gain", high="2000 mV/N")
    assert (noise.value, noise.outcome, noise.values) == (5.0, "fail", 2)
    assert (gain.value, gain.outcome, gain.values, gain.unit) == (3.0, "fail", 2, "V/N")


def test_results_of_one_name_are_judged_each() -> None:
    loads = tuple(Budget("load", value, "N", (Component("all", 0.01),)) for value in (1.0, 4.0, 2.0))
    failed, passed = (judged([], "load", budgets=loads, high=high) for high in ("3 N", "5 N"))
    assert (failed.value, failed.outcome, passed.outcome) == (4.0, "fail", "pass")


@pytest.mark.parametrize(("freedom", "outcome"), [(math.inf, "pass"), (3, "undecided")])
def test_few_degrees_of_freedom_widen_the_guard_band(freedom: float, outcome: str) -> None:
    budget = Budget("x", 1.0, "N", (Component("all", 0.1, degrees_of_freedom=freedom),))
    assert judged([], "x", budgets=(budget,), high="1.2 N").outcome == outcome


def test_an_interval_by_monte_carlo_is_judged_by_its_ends(tmp_path: Path) -> None:
    with palpate.open_bench(scene="thesis_single", seed=2) as bench:
        done = palpate.run(palpate.ModulusTest("4", steps=4), bench, out=tmp_path / "run")
    for result in done.result.budgets:
        limits = {result.budget.quantity: {"high": f"{result.high!r} {result.budget.unit}".strip(), "risk": 0.02}}
        (verdict,) = palpate.judge(done.run, limits).verdicts
        assert (verdict.outside, verdict.outcome) == (pytest.approx(0.025), "undecided")


# --- the commands --------------------------------------------------------------------------------------


def test_the_command_of_each_procedure_has_limits(palpate: Palpate) -> None:
    for name in SHIPPED:
        shown = palpate("measure", "modulus" if name == "measure-modulus" else name, "--help").out
        assert "--limits FILE" in shown and "--junit FILE" in shown, name


def test_a_command_tells_its_verdicts_and_writes_them_for_ci(palpate: Palpate) -> None:
    file = limits_file(
        f'["{RATIO}"]\nlow = 0.2\nhigh = 0.9\nprior = {{ mean = 0.3, sd = 0.2 }}\n[load_N]\nhigh = "9 N"\n'
    )
    said = palpate(*COMMAND[:-1], "--limits", file, "--junit", "verdicts.xml", "--json")
    found = json.loads(said.out)
    note = "palpate: note: there is no standard uncertainty, so the verdict will be undecided: load_N\n"
    assert (said.status, said.err) == (4, note)
    assert (found["verdict"], [each["outcome"] for each in found["verdicts"]]) == ("undecided", ["pass", "undecided"])
    (suite,) = ElementTree.parse("verdicts.xml").getroot()  # of our own
    assert {name: suite.get(name) for name in ("name", "tests", "failures", "errors")} == {
        "name": "sweep-loads", "tests": "2", "failures": "0", "errors": "1",
    }  # fmt: skip
    first, _ = suite.findall("testcase")
    told = {each.get("name"): each.get("value") for each in first.findall("properties/property")}
    verdict, undecided = found["verdicts"]
    numbers = {name: float(str(text)) for name, text in told.items() if name != "unit"}
    assert numbers == {
        **{name: verdict[name] for name in ("value", "u", "low", "high", "risk", "outside")},
        "prior_mean": 0.3, "prior_sd": 0.2,
    }  # fmt: skip
    assert [each.get("message") for each in suite.iter("error")] == [undecided["reason"]]
    assert list(suite.iter("failure")) == first.findall("error") == []
    assert json.loads(palpate("judge", found["run"], file, "--json").out)["verdicts"] == found["verdicts"]


def test_people_are_shown_a_table_and_the_reasons(swept: palpate.Finished[Any], palpate: Palpate) -> None:
    said = palpate("judge", str(swept.folder), limits_file(f'["{RATIO}"]\nhigh = 0.1\n[load_N]\nhigh = "9 N"\n'))
    assert said.status == 3
    for told in (
        "SIMULATED Verdicts",
        f"fail           {RATIO}: ",
        "is above 0.1 with a probability of 100 %",
        "undecided      load_N: point 1: ",
    ):
        assert told in said.out


def test_names_are_escaped_in_xml(swept: palpate.Finished[Any], tmp_path: Path) -> None:
    name = """<script a="'&]]>"""
    budget = Budget(name, 1.0, "N", (Component("all", 0.1),))
    write_junit(
        palpate.judge(SimpleResult([], budgets=(budget,)), {name: {"high": "0.1 N"}}), swept.run, tmp_path / "v.xml"
    )
    (case,) = ElementTree.parse(tmp_path / "v.xml").iter("testcase")
    assert case.get("name") == name


BAD = {
    "": "has no limits; give a table for each quantity",
    "[x]": "limits.toml: x: it has neither low nor high; give one or both",
    "force_ratio = 3": "force_ratio is no table; write [force_ratio] on a line of its own",
    "[force_ratoi]\nlow = 1": "unknown quantity 'force_ratoi' (did you mean 'force_ratio'?); valid: ",
    "[sample]\nlow = 1": "unknown quantity 'sample'",
    "[force_ratio]\nlow = 1\nhigh = 0.5": "force_ratio: low = 1 is not below high = 0.5; exchange them",
    "[load_N]\nlow = '1 N'\nhigh = '900 mN'": "load_N: low = 1 N is not below high = 900 mN",
    "[force_ratio]\nlow = 0.1\nlow = 0.2": "is not TOML: Cannot overwrite a value",
    "[force_ratio]\nlow = 0.1\n[force_ratio]\nlow = 0.2": "Cannot declare ('force_ratio',) twice",
    "[force_ratio]\nlo = 0.1": "force_ratio: lo: unknown key (did you mean 'low'?); valid: high, low, prior, risk",
    "[force_ratio]\nlow = 0.1\nrisk = 0": "force_ratio: risk: '0' is not above 0; give a share such as '5 %'",
    "[force_ratio]\nlow = 0.1\nrisk = 1e-300": "is below 1e-09; no uncertainty is known so well",
    "[force_ratio]\nlow = 0.1\nrisk = '51 %'": "force_ratio: risk: '51 %' is 51 %, above the 50 % that are allowed",
    "[force_ratio]\nlow = nan": "force_ratio: low: nan is no finite number and no text",
    "[force_ratio]\nlow = true": "force_ratio: low: True is no finite number and no text",
    "[force_ratio]\nlow = '1e999'": "force_ratio: low: '1e999' is not finite",
    "[force_ratio]\nlow = '3 N'": "force_ratio: low: '3 N' is in N where a plain number belongs",
    "[load_N]\nlow = 3": "load_N: low: '3' has no unit where N belongs",
    "[load_N]\nhigh = '3 Nn'": "load_N: '3 Nn': 'Nn' is no unit",
    "['force ratio of sample 1']\nhigh = '3 N'\nlow = '1 m'": "high: '3 N' is in N where m belongs",
    "[load_N]\nhigh = '__import__(\"os\")'": "is not a quantity",
    "[load_N]\nhigh = '3 N'\nprior = { mean = '3 N', sd = '0 N' }": "load_N: prior.sd = 0 N is not above 0",
    "[load_N]\nhigh = '3 N'\nprior = { mean = '3 N', sd = '1 m' }": "load_N: prior.sd: '1 m' is in m where N belongs",
    "[load_N]\nhigh = '3 N'\nprior = 'none'": "load_N: prior: 'none' is no table",
    '["a\\u0001"]\nlow = 1': "is no name of a quantity",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_limits_are_one_error_before_a_bench_is_opened(palpate: Palpate, text: str) -> None:
    said = palpate(*COMMAND, "--limits", limits_file(text)).refusal
    assert said.startswith("limits.toml: ") and BAD[text] in said
    assert not Path("runs").exists()


def test_junit_without_limits_and_a_missing_file_are_refused(palpate: Palpate) -> None:
    assert "--junit: it holds verdicts of limits" in palpate(*COMMAND, "--junit", "verdicts.xml").complaint
    assert "--junit .: is a folder; name a file" in palpate("judge", "run", "limits.toml", "--junit", ".").complaint
    assert "missing.toml" in palpate(*COMMAND, "--limits", "missing.toml").complaint


def test_what_only_the_result_can_tell_is_noted_before_and_an_error_after_it(palpate: Palpate) -> None:
    file = limits_file("['force ratio of sampel 1']\nlow = 0.1\n")
    dry = palpate(*COMMAND[:-1], "--limits", file, "--dry-run", "--json")
    note = "only the result tells whether it has what limits.toml limits: force ratio of sampel 1"
    assert (dry.status, note in dry.err) == (0, True)
    said = palpate(*COMMAND, "--limits", file).refusal
    assert "limits.toml: unknown quantity of this result 'force ratio of sampel 1' (did you mean" in said
    assert "the run is kept in" in said


def test_a_run_that_has_not_ended_is_not_judged(tmp_path: Path) -> None:
    interrupted = pytest.raises(KeyboardInterrupt)
    with palpate.open_bench(scene="noisy_lab", seed=4) as bench, interrupted:
        palpate.run(SWEEP, bench, out=tmp_path / "run", listeners=[steps(interrupt_at(1))])
    with pytest.raises(palpate.UsageError, match="is stopped, so it has no result"):
        palpate.judge(palpate.read(tmp_path / "run"), {RATIO: {"low": 0.1}})
