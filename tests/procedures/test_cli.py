"""What the command line promises: help, one JSON object, SIMULATED everywhere, safe and readable ends."""

from __future__ import annotations

import signal
import sys
from io import StringIO
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from palpate import Run, UsageError
from palpate.extend import Recorder
from palpate.instrument.models.table import MODELS
from palpate.procedures.commands.root import palpate as root
from tests.procedures.conftest import IDEAL_SCENE, OFF, Benches, Palpate, commands, outputs

SMALL = ("sweep", "loads", "--samples", "1,2", "--loads", "2 N, 3 N", "--dwell", "0.2 s")
ONE_POINT = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s")


# --- help ----------------------------------------------------------------------------------------------


def test_every_command_has_help_and_those_that_do_something_have_examples(palpate: Palpate) -> None:
    for path, command in commands():
        said = palpate(*path, "--help")
        assert (said.status, said.err) == (0, ""), path
        assert said.out.startswith("Usage: palpate"), path
        options = {option for each in command.params for option in each.opts}
        if isinstance(command, click.Group):
            assert "..." not in said.out.split("Commands:")[1].split("Examples:")[0], path  # no summary is cut off
        else:
            assert f"palpate {' '.join(path)}" in said.out.split("Examples:")[1]
            assert {"--json", "--quiet"} <= options, path
        if path in (("sweep", "loads"), ("calibrate", "load-cell")):
            assert {"--out", "--seed", "--bench", "--scene"} <= options


def test_an_option_of_one_value_that_is_given_twice_is_refused_by_every_command(palpate: Palpate) -> None:
    for _, command in commands():
        for option in command.params:
            if isinstance(option, click.Option) and not (option.is_flag or option.multiple):
                name = option.opts[0]
                with pytest.raises(UsageError, match=f"^{name} is given 2 times, as '1 s' and '2 s'; give it once$"):
                    command.parse_args(click.Context(command), [name, "1 s", f"{name}=2 s"])
    loads = root.commands["sweep"].commands["loads"]  # type: ignore[attr-defined]
    loads.parse_args(click.Context(loads, resilient_parsing=True), 2 * ["--dwell", "1 s"])  # a shell that completes
    said = palpate("sweep", "loads", "--dwell", "1 s", "--dwell", "2 s")
    assert (said.status, said.complaint) == (2, "--dwell is given 2 times, as '1 s' and '2 s'; give it once")


@pytest.mark.parametrize(
    ("command", "option", "text"),
    [
        ("sweep loads", "--loads", "abc"),
        ("sweep loads", "--samples", "9"),
        ("sweep loads", "--tolerance", "5"),
        ("calibrate load-cell", "--positions", "a"),
        ("softness", "--modulus", "60 kPa, x"),
        ("scene explain ideal", "--load", "x"),
        ("measure modulus", "--mounting-scatter", "1 s,"),
        ("model ratio --sensed-modulus 1kPa", "--plate-modulus", "hard"),
        ("model ratio --sensed-modulus 1kPa", "--at", "1 mm"),
        ("serve ideal", "--step", "fast"),
    ],
)
def test_an_option_whose_text_cannot_be_read_is_named(palpate: Palpate, command: str, option: str, text: str) -> None:
    said = palpate(*command.split(), option, text)
    assert (said.status, said.out, said.complaint.count(option)) == (2, "", 1)


# --- what a sweep says ---------------------------------------------------------------------------------


def test_the_progress_bar_stays_off_stdout_and_quiet_says_nothing(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    said = palpate(*ONE_POINT, "--json")
    assert said.object["simulated"] is True
    assert "sample 1, 2 N" in said.err
    said = palpate(*ONE_POINT, "--quiet")
    assert (said.status, said.out, said.err, len(list(Path("runs").iterdir()))) == (0, "", "", 2)


def test_whatever_is_said_of_a_simulated_sweep_is_stamped_and_names_scene_model_and_seed(palpate: Palpate) -> None:
    Path("my.toml").write_text(IDEAL_SCENE, encoding="utf-8")
    said = palpate(*SMALL, "--out", "day")
    assert (said.status, said.err) == (0, "")
    assert said.out.startswith("SIMULATED Load sets")
    day = Path("day").absolute()
    for text in (
        "\nSIMULATED Mean force ratio", "softness order, hard to soft: 1 > 2   (thesis: 1 > 2)",
        f"run            {day}\n", f"plot           {day / 'plot.png'}\n", "calibration    thesis Table 5.1\n",
    ):  # fmt: skip
        assert text in said.out
    other = palpate(
        *ONE_POINT, "--scene", "my.toml", "--model", "column", "--seed", "7", "--out", "other", "--json"
    ).object
    assert (other["scene"], other["model"], other["seed"]) == ("ideal", "column", 7)
    assert b'"simulated":true' in Path("other/run.record").read_bytes()
    assert Run.open(Path("other")).header["seed"] == 7
    assert abs(other["points"][0]["force_ratio"] / Run.open(day).points()[0]["force_ratio"] - 1) > 0.1
    assert palpate("runs", "show", "day").out.startswith("SIMULATED ")
    shown = palpate("runs", "show", "day", "--json").object
    assert shown["simulated"] is True
    (*_, row) = palpate("runs", "list", "--out", ".", "--json").object["runs"]
    assert (row["simulated"], row["status"]) == (True, "complete")
    assert "SIMULATED" in palpate("runs", "list", "--out", ".").out


# --- runs ----------------------------------------------------------------------------------------------


# --- a bench file --------------------------------------------------------------------------------------


def test_a_bench_file_gives_what_the_simulated_bench_gives(
    palpate: Palpate, lab: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", StringIO("1\n2\n"))
    said = palpate(*SMALL, "--bench", lab, "--json")
    served, own = said.object, palpate(*SMALL, "--json").object
    assert served["points"] == own["points"]
    assert Run.open(Path(served["run"])).digest() == Run.open(Path(own["run"])).digest()
    named = ("simulated", "scene", "seed", "mounting")
    assert [served[name] for name in named] == [True, None, None, "confirmed"]
    assert [own[name] for name in named] == [True, "thesis_single", 1, "simulated"]
    assert said.err.splitlines() == [
        "Mount sample 1 (white silicone rubber, 3 mm); then type 1 and press Enter",
        "Mount sample 2 (Neoprene G-231-N, 3 mm); then type 2 and press Enter",
    ]


def test_a_person_sees_how_long_it_takes_and_what_is_asked_beside_the_progress_bar_and_may_interrupt_there(
    palpate: Palpate, lab: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[str] = []

    class Console(StringIO):
        def readline(self, _size: int | None = -1) -> str:
            seen.append(capsys.readouterr().err)
            raise KeyboardInterrupt

    monkeypatch.setattr(sys, "stdin", Console())
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    assert palpate(*ONE_POINT, "--bench", lab, "--out", "day").status == 130
    assert "sweep-loads: about 1 min" in seen[0].partition("Mount sample 1")[0]
    assert Run.open(Path("day")).status == "stopped"


# --- ends ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "at", "status", "message", "loads"),
    [
        (signal.SIGINT, "sample 1, 3 N", 130, "interrupted\npoints already taken are", [2.0]),
        (signal.SIGTERM, "sample 1, 3 N", 143, "terminated\npoints already taken are", [2.0]),
        (signal.SIGHUP, "sample 1, 3 N", 129, "hung up\npoints already taken are", [2.0]),
        (signal.SIGINT, "sample 1, 2 N", 130, "interrupted\nno point was taken; the begun run is", []),
    ],
)
def test_ctrl_c_sigterm_and_a_closed_terminal_stop_the_outputs_and_then_close_the_run_and_tell_what_is_kept(
    palpate: Palpate, benches: Benches, on_progress: Any, monkeypatch: pytest.MonkeyPatch,
    number: signal.Signals, at: str, status: int, message: str, loads: list[float],
) -> None:  # fmt: skip
    closed: list[tuple[tuple[bool, bool, float], str]] = []
    finish = Recorder.finish

    def watched(self: Recorder, state: Any, *args: Any) -> None:
        closed.append((outputs(benches[0]), state))
        finish(self, state, *args)

    monkeypatch.setattr(Recorder, "finish", watched)
    driven: list[tuple[bool, bool, float]] = []

    def interrupt(_done: int, _total: int, what: str) -> None:
        if what == at:
            driven.append(outputs(benches[0]))
            signal.raise_signal(number)

    on_progress(interrupt)
    said = palpate(*SMALL, "--out", "day", "--json")
    day = Path("day").absolute()
    kept = f"palpate: {message} kept in {day}; go on with: palpate runs resume {day}\nthe outputs are off\n"
    assert (said.status, said.out, said.err.lstrip("\n")) == (status, "", kept)
    assert ([on for *on, amplitude in driven if amplitude], closed) == ([[True, True]] * len(loads), [(OFF, "stopped")])
    assert (Run.open(Path("day")).status, [p["load_N"] for p in Run.open(Path("day")).points()]) == ("stopped", loads)


# --- names that a shell completes ---------------------------------------------------------------------


SCENES = ("sweep loads --scene", "scene show", "serve", "accuracy --scene")


def completed(line: str) -> list[str]:
    """What bash is told: kind and value of each completion of the last word."""
    variables = {"_PALPATE_COMPLETE": "bash_complete", "COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}
    return CliRunner().invoke(root, prog_name="palpate", env=variables).output.split()


@pytest.mark.parametrize(
    ("command", "begun", "found"),
    [
        *((command, "thesis_s", {"plain,thesis_single"}) for command in SCENES),
        *((command, "./mine", {"file,./mine"}) for command in SCENES),
        *((f"{command} --model", "sol", {"plain,solid"}) for command in ("model ratio", "softness", "sweep loads")),
        ("softness --model", "", {f"plain,{name}" for name in (*MODELS, "auto")}),
    ],
)
def test_scenes_and_else_files_and_every_model_are_completed(command: str, begun: str, found: set[str]) -> None:
    assert set(completed(f"palpate {command} {begun}")) == found


def test_runs_of_the_store_are_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path / "none"))
    assert completed("palpate runs show ni") == ["file,ni"]
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path))
    header = {"procedure": "sweep-loads", "simulated": True, "started": "2025-01-01T00:00:00Z"}
    Recorder.create(tmp_path / "night-1", header).finish("complete", {})
    (tmp_path / "night-notes").mkdir()
    for command in ("runs show", "runs check", "judge", "runs report", "runs report night-0"):
        assert completed(f"palpate {command} ni") == ["plain,night-1"]
