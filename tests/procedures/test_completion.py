"""A shell completes the names of scenes, models and runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from palpate.instrument.models.table import MODELS
from palpate.procedures.commands.root import palpate as root
from palpate.procedures.records.record import Recorder


def completed(line: str) -> list[str]:
    """What bash is told: kind and value of each completion of the last word."""
    variables = {"_PALPATE_COMPLETE": "bash_complete", "COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}
    return CliRunner().invoke(root, prog_name="palpate", env=variables).output.split()


@pytest.mark.parametrize("command", ["sweep loads --scene", "scene show", "serve", "accuracy --scene"])
def test_scenes_are_completed_and_else_files(command: str) -> None:
    assert completed(f"palpate {command} thesis_s") == ["plain,thesis_single"]
    assert completed(f"palpate {command} ./mine") == ["file,./mine"]


@pytest.mark.parametrize("command", ["model ratio", "softness", "sweep loads"])
def test_every_model_is_completed(command: str) -> None:
    assert set(completed(f"palpate {command} --model ")) == {f"plain,{name}" for name in (*MODELS, "auto")}
    assert completed(f"palpate {command} --model sol") == ["plain,solid"]


def test_runs_of_the_store_are_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path / "none"))
    assert completed("palpate runs show ni") == ["file,ni"]
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path))
    header = {"procedure": "sweep-loads", "simulated": True, "started": "2025-01-01T00:00:00Z"}
    Recorder.create(tmp_path / "night-1", header).finish("complete", {})
    (tmp_path / "night-notes").mkdir()
    for command in ("runs show", "runs check", "judge", "runs report", "runs report night-0"):
        assert completed(f"palpate {command} ni") == ["plain,night-1"]
