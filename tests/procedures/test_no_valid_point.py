"""A run without a valid point has no result: it says so, with the reason, and every mark is explained where it is."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.table import Table

from palpate import EstimateError, get_design
from palpate.extend import SimpleResult
from palpate.instrument.signals.estimate import fit_sine
from palpate.procedures.commands.options import Output
from palpate.procedures.commands.procedures import tell_result
from palpate.procedures.showing.text import MARKS, legend
from palpate.procedures.steps import film_point, flags
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import FilmRecord
from palpate.procedures.steps.flags import CLIPPED, FLAGS
from palpate.procedures.steps.policy import ATTEMPTS
from tests.examples.relaxation import Relaxation
from tests.procedures.conftest import IDEAL_SCENE, Palpate

OFF = IDEAL_SCENE + "\n[effects.frequency_error]\nbits = 28\n"  # 10 Hz comes as 9.965 Hz
LOADS = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s")
SLOW = [
    ("softness", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s"),
    ("sweep", "frequency", "--frequencies", "8 Hz, 9 Hz, 10 Hz", "--dwell", "0.4 s"),
    ("sweep", "temperature", "--temperatures", "0 K, 5 K, 15 K, 10 K", "--soak", "60 s", "--dwell", "0.2 s"),
]


@pytest.fixture
def off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr("palpate.procedures.steps.film_point.ATTEMPTS", 1)
    scene = tmp_path / "off.toml"
    scene.write_text(OFF)
    return str(scene)


def test_a_sweep_without_a_valid_point_fails_with_the_reason_and_where_the_points_are(
    palpate: Palpate, off: str
) -> None:
    said = palpate(*LOADS, "--scene", off, "--json")
    found = json.loads(said.out)
    assert (said.status, [point["valid"] for point in found["points"]]) == (1, [False])
    error, kept = said.err.splitlines()
    assert error.startswith("palpate: error: no point of 1 is valid, so there is no result. frequency (1): ")
    assert found["run"] in kept
    shown = palpate("runs", "show", found["run"])
    assert shown.status == 0
    assert f"frequency      {FLAGS['frequency']}" in " ".join(shown.out.split("\n"))


@dataclass(frozen=True)
class Flagged:
    valid: bool
    flags: tuple[str, ...]


def test_so_does_a_procedure_of_ones_own_whose_points_are_flagged_and_one_of_unjudged_points_does_not() -> None:
    own = Relaxation()
    with pytest.raises(EstimateError, match=r"no point of 1 is valid, so there is no result\. clipped"):
        own.check_result(SimpleResult([Flagged(False, ("clipped",))]))
    own.check_result(SimpleResult([Flagged(False, ("clipped",)), Flagged(True, ())]))
    own.check_result(SimpleResult([]))


@pytest.mark.slow
@pytest.mark.parametrize("command", SLOW, ids=" ".join)
def test_so_does_every_procedure_that_judges_its_points(palpate: Palpate, off: str, command: tuple[str]) -> None:
    said = palpate(*command, "--scene", off)
    assert said.status == 1
    assert "is valid, so there is no result. frequency" in said.err
    assert f"frequency      {FLAGS['frequency']}" in said.out


def test_every_flag_of_a_point_is_explained_with_the_numbers_that_count() -> None:
    named = {name: value for name, value in vars(flags).items() if name.isupper() and not name.startswith("_")}
    assert set(FLAGS) == {value for value in named.values() if isinstance(value, str)}
    assert set(FLAGS) > flags.USED
    assert all(
        f"by noise alone only {1e5 * film_point.FALSE_ALARMS:.0f} points of 100,000 differ so much" in FLAGS[flag]
        for flag in ("force", "frequency")
    )
    assert f"after {ATTEMPTS} attempts" in MARKS["NO"]


@pytest.mark.parametrize("mark", MARKS)
def test_a_mark_is_explained_below_the_table_in_which_it_stands_and_no_other(mark: str) -> None:
    table, clean = Table("sample", "load", "valid"), Table("sample", "load", "valid")
    cells: dict[str, Any] = {"*": ("1", "2*", "yes"), "-": ("1", "-", "yes"), "NO": ("1", "2", "NO")}
    table.add_row(*cells.get(mark, ("1", "2", f"yes {mark}")))
    clean.add_row("1", "2", "yes")
    assert (legend(table), legend(clean)) == ([f"{mark:<14} {MARKS[mark]}"], [])


def test_a_result_without_a_budget_says_so_where_one_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for asked in (True, False):
        tell_result(Output(as_json=False, quiet=False, budgets=asked), {"simulated": True}, list)
        said.append(capsys.readouterr().out)
    assert said == ["this procedure gives no uncertainty budget; its points and results have their uncertainties\n", ""]


def test_a_flagged_point_of_a_dead_base_film_names_its_flags_as_the_cause() -> None:
    rate, cycles = 1000.0, np.arange(200) / 1000.0
    volts = np.stack([0.1 * np.sin(2 * np.pi * 10.0 * cycles), np.zeros(200)])
    volts[:, ::7] += 1e-6
    record = FilmRecord(rate, cycles, volts, np.ones(volts.shape, bool))
    point = FilmPoint(2.0, 0.1, 20.0, fit_sine(cycles, volts, 10.0), record, 0.2, None, 0.0, 3, (CLIPPED,))
    with pytest.raises(EstimateError, match=r"^clipped: .*; take a smaller load \(film 'total' .* too little for"):
        point.forces(get_design("single"))
    with pytest.raises(EstimateError, match=r"^film 'total' "):
        replace(point, flags=()).forces(get_design("single"))
