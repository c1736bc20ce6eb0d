"""palpate accuracy integrators: what each method costs, with its failures left in."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from palpate.procedures.commands.root import palpate
from palpate.simulators.linear import integrators
from palpate.simulators.linear.integrators import STATES, STIFFNESS, IntegratorError, chain, compare


@pytest.fixture(scope="module")
def measured() -> list[IntegratorError]:
    """Each method once, on a short record."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(integrators, "DURATION", 1.0)
        patch.setattr(integrators, "REPEATED", 0.0)
        patch.setattr(integrators, "TOLERANCES", {"Radau": (1e-3,), "LSODA": (1e-6, 1e-9)})
        return list(compare())


@pytest.fixture
def shown(measured: list[IntegratorError], monkeypatch: pytest.MonkeyPatch) -> None:
    """The command shows these."""
    monkeypatch.setattr(integrators, "compare", lambda: iter(measured))


def test_the_chain_is_as_stiff_and_as_large_as_is_said() -> None:
    rates = np.abs(np.linalg.eigvals(chain().a))
    assert len(rates) == STATES
    assert rates.max() / rates.min() == pytest.approx(STIFFNESS, rel=1e-9)


def test_exact_methods_are_exact_and_the_others_as_good_as_their_order_says(measured: list[IntegratorError]) -> None:
    rows: dict[str, list[IntegratorError]] = {}
    for row in measured:
        rows.setdefault(row.method, []).append(row)
    errors: dict[str, Any] = {method: [row.error for row in own] for method, own in rows.items()}
    assert errors["closed form"][0] < 1e-12
    assert errors["matrix exponential, blocks"][0] < 1e-9
    for method in ("first-order hold", "trapezoid"):  # second order: a step ten times finer is a hundred times better
        assert errors[method][1] / errors[method][2] == pytest.approx(100, rel=0.05)
    assert errors["Radau"][0] < 1e-2
    assert errors["LSODA"][1] < errors["LSODA"][0] < 1e-4
    fails, holds = rows["explicit Euler"]  # 2.1 and 1.9 us: a microsecond is followed up to a step of two
    assert (fails.error, fails.failure) == (None, "diverges")
    assert holds.error is not None and holds.error < 1e-2


@pytest.mark.slow
@pytest.mark.usefixtures("shown")
def test_the_command_gives_table_plot_and_json(tmp_path: Path) -> None:
    runner = CliRunner()
    done = runner.invoke(palpate, ["accuracy", "integrators", "--json", "--out", str(tmp_path / "new")])
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert (answer["states"], answer["stiffness_ratio"]) == (STATES, STIFFNESS)
    failed = [(row["method"], row["failure"]) for row in answer["methods"] if row["error"] is None]
    assert failed == [("explicit Euler", "diverges"), ("Bouc-Wen, explicit Euler", "runs away")]
    hysteresis = [row["error"] for row in answer["methods"] if row["method"].startswith("Bouc-Wen")]
    assert max(hysteresis[:2]) < 1e-12 < 1e-3 < hysteresis[3] < 0.3  # exact twice, Euler at 100 and 1000 steps a cycle
    assert Path(answer["plot"]).read_bytes().startswith(b"\x89PNG")
    shown = runner.invoke(palpate, ["accuracy", "integrators"]).stdout
    assert "closed form" in shown and "diverges" in shown
    assert runner.invoke(palpate, ["accuracy", "integrators", "--quiet"]).stdout == ""


@pytest.mark.usefixtures("shown")
def test_a_plot_that_cannot_be_kept_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = CliRunner().invoke(palpate, ["accuracy", "integrators", "--out", str(tmp_path / "file"), "--json"])
    assert done.exit_code != 0
    assert "file" in str(done.exception)
