"""What the command line promises: help, one JSON object, SIMULATED everywhere, safe and readable ends."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from typing import Any

import click
import pandas as pd
import pytest

from palpate.instrument.errors import UsageError
from palpate.procedures.commands.root import palpate as root
from palpate.procedures.console.terminal import Progress
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from tests.procedures.conftest import IDEAL_SCENE, OFF, Benches, Palpate, outputs

SMALL = ("sweep", "loads", "--samples", "1,2", "--loads", "2 N, 3 N", "--dwell", "0.2 s")
ONE_POINT = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s")


def commands(group: click.Group, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    yield path, group
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


# --- help ----------------------------------------------------------------------------------------------


def test_every_command_has_help_and_those_that_do_something_have_examples(palpate: Palpate) -> None:
    for path, command in commands(root):
        said = palpate(*path, "--help")
        assert (said.status, said.err) == (0, ""), path
        assert said.out.startswith("Usage: palpate"), path
        if isinstance(command, click.Group):
            assert "..." not in said.out.split("Commands:")[1].split("Examples:")[0], path  # no summary is cut off
        else:
            assert f"palpate {' '.join(path)}" in said.out.split("Examples:")[1]
            assert {"--json", "--quiet"} <= {option for p in command.params for option in p.opts}, path


@pytest.mark.parametrize("path", [("sweep", "loads"), ("calibrate", "load-cell")])
def test_every_command_that_uses_a_bench_takes_the_same_options(palpate: Palpate, path: tuple[str, ...]) -> None:
    text = palpate(*path, "--help").out
    for option in ("--json", "--out DIR", "--seed", "--bench FILE", "--scene NAME|FILE", "--quiet"):
        assert option in text


def test_an_option_of_one_value_that_is_given_twice_is_refused_by_every_command(palpate: Palpate) -> None:
    for _, command in commands(root):
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
    assert (said.status, said.out) == (2, "")
    assert said.complaint.count(option) == 1


def test_an_option_of_several_values_takes_them_and_a_flag_may_stand_twice(palpate: Palpate) -> None:
    said = palpate(
        "calibrate", "model", "--reference", "A: 48 kPa ± 2 %", "--reference", "nonsense", "--json", "--json"
    )
    assert "nonsense" in said.complaint


# --- what a sweep says ---------------------------------------------------------------------------------


def test_the_progress_bar_stays_off_stdout(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    said = palpate(*ONE_POINT, "--json")
    assert said.object["simulated"] is True
    assert "sample 1, 2 N" in said.err
    assert palpate(*ONE_POINT, "--json", "--quiet").err == ""


def test_quiet_says_nothing(palpate: Palpate) -> None:
    said = palpate(*ONE_POINT, "--quiet")
    assert (said.status, said.out, said.err) == (0, "", "")
    assert len(list(Path("runs").iterdir())) == 1


def test_the_table_is_stamped_and_says_where_everything_is(palpate: Palpate) -> None:
    said = palpate(*SMALL, "--out", "day")
    assert (said.status, said.err) == (0, "")
    assert said.out.startswith("SIMULATED Load sets")
    assert "\nSIMULATED Mean force ratio" in said.out
    assert "softness order, hard to soft: 1 > 2   (thesis: 1 > 2)" in said.out
    assert f"run            {Path('day').absolute()}\n" in said.out
    assert f"plot           {Path('day').absolute() / 'plot.png'}\n" in said.out
    assert "calibration    thesis Table 5.1\n" in said.out


def test_the_record_the_shown_run_and_the_list_are_stamped(palpate: Palpate) -> None:
    folder = Path(palpate(*ONE_POINT, "--json").object["run"])
    assert b'"simulated":true' in (folder / "run.record").read_bytes()
    assert palpate("runs", "show", folder.name).out.startswith("SIMULATED ")
    assert palpate("runs", "show", folder.name, "--json").object["simulated"] is True
    listed = palpate("runs", "list").out
    assert "SIMULATED" in listed and "sweep-loads" in listed
    (row,) = palpate("runs", "list", "--json").object["runs"]
    assert (row["run"], row["simulated"], row["status"], row["points"]) == (str(folder), True, "complete", 1)


def test_a_model_a_seed_and_a_scene_are_used_and_named(palpate: Palpate) -> None:
    Path("my.toml").write_text(IDEAL_SCENE, encoding="utf-8")
    plain = palpate(*ONE_POINT, "--scene", "my.toml", "--json").object
    other = palpate(*ONE_POINT, "--scene", "my.toml", "--model", "column", "--seed", "7", "--json").object
    assert (plain["scene"], plain["model"], plain["seed"]) == ("ideal", "experiment", 1)
    assert (other["scene"], other["model"], other["seed"]) == ("ideal", "column", 7)
    assert abs(other["points"][0]["force_ratio"] / plain["points"][0]["force_ratio"] - 1) > 0.1
    assert Run.open(Path(other["run"])).header["seed"] == 7


# --- determinism ---------------------------------------------------------------------------------------


# --- runs ----------------------------------------------------------------------------------------------


def test_a_run_is_exported_once(palpate: Palpate) -> None:
    result = palpate(*SMALL, "--out", "day", "--json").object
    reads: dict[str, Any] = {"csv": pd.read_csv, "parquet": pd.read_parquet}
    for to, read in reads.items():
        files = palpate("runs", "export", "day", "--to", to, "--out", "tables", "--json").object["files"]
        assert files == [f"tables/points.{to}", f"tables/waveforms.{to}"]
        points, waveforms = (read(file) for file in files)
        assert points["force_ratio"].tolist() == pytest.approx([p["force_ratio"] for p in result["points"]])
        assert points["simulated"].all()
        assert waveforms["simulated"].all()
        assert len(waveforms) == 4 * 2 * 50
        before = [Path(file).read_bytes() for file in files]
        again = palpate("runs", "export", "day", *(("--to", to) if to != "csv" else ()), "--out", "tables")
        assert again.status == 2
        assert "exists and is not overwritten" in again.complaint
        assert [Path(file).read_bytes() for file in files] == before


def test_the_contracts_are_exported(palpate: Palpate) -> None:
    files = palpate("contracts", "export", "--to", "maps", "--json").object["files"]
    assert {".md", ".eds", ".dbc"} <= {Path(file).suffix for file in files}
    assert all(Path(file).stat().st_size > 0 for file in files)


# --- a bench file --------------------------------------------------------------------------------------


def test_a_bench_file_gives_what_the_simulated_bench_gives(
    palpate: Palpate, lab: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", StringIO("1\n2\n"))
    said = palpate(*SMALL, "--bench", lab, "--json")
    own = palpate(*SMALL, "--json").object
    assert said.object["points"] == own["points"]
    assert (said.object["simulated"], said.object["scene"], said.object["seed"]) == (True, None, None)
    assert (said.object["mounting"], own["mounting"]) == ("confirmed", "simulated")
    first, second = said.err.splitlines()
    assert first == "Mount sample 1 (white silicone rubber, 3 mm); then type 1 and press Enter"
    assert second == "Mount sample 2 (Neoprene G-231-N, 3 mm); then type 2 and press Enter"
    assert Run.open(Path(said.object["run"])).digest() == Run.open(Path(own["run"])).digest()


def test_a_person_sees_how_long_it_takes_and_what_is_asked_beside_the_progress_bar(
    palpate: Palpate, lab: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[str] = []

    class Console(StringIO):
        def readline(self, _size: int | None = -1) -> str:
            seen.append(capsys.readouterr().err)
            return "1\n"

    monkeypatch.setattr(sys, "stdin", Console())
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    assert palpate(*ONE_POINT, "--bench", lab).status == 0
    assert "sweep-loads: about 1 min" in seen[0].partition("Mount sample 1")[0]


# --- ends ----------------------------------------------------------------------------------------------


def interrupted_at(_done: int, _total: int, what: str) -> None:
    if what == "sample 1, 3 N":
        raise KeyboardInterrupt


def interrupted_before(_done: int, _total: int, what: str) -> None:
    if what == "sample 1, 2 N":
        raise KeyboardInterrupt


def terminated_at(_done: int, _total: int, what: str) -> None:
    if what == "sample 1, 3 N":
        signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize(
    ("report", "status", "message"),
    [(interrupted_at, 130, "palpate: interrupted\n"), (terminated_at, 143, "palpate: terminated\n")],
)
def test_ctrl_c_and_sigterm_stop_the_outputs_and_then_close_the_run(
    palpate: Palpate, benches: Benches, on_progress: Any, monkeypatch: pytest.MonkeyPatch,
    report: Progress, status: int, message: str,
) -> None:  # fmt: skip
    closed: list[tuple[tuple[bool, bool, float], str]] = []
    finish = Recorder.finish

    def watched(self: Recorder, state: Any, *args: Any) -> None:
        closed.append((outputs(benches[0]), state))
        finish(self, state, *args)

    monkeypatch.setattr(Recorder, "finish", watched)
    on_progress(report)
    said = palpate(*SMALL, "--out", "day", "--json")
    assert (said.status, said.out) == (status, "")
    day = Path("day").absolute()
    kept = f"points already taken are kept in {day}; go on with: palpate runs resume {day}\nthe outputs are off\n"
    assert said.err.lstrip("\n") == message + kept
    assert closed == [(OFF, "stopped")]
    run = Run.open(Path("day"))
    assert run.status == "stopped"
    assert [p["load_N"] for p in run.points()] == [2.0]
    assert palpate("runs", "show", "day").status == 0


def test_ctrl_c_before_the_first_point_tells_what_is_kept_and_that_the_outputs_are_off(
    palpate: Palpate, benches: Benches, on_progress: Any
) -> None:
    on_progress(interrupted_before)
    said = palpate(*SMALL, "--out", "day", "--json")
    day = Path("day").absolute()
    kept = f"no point was taken; the begun run is kept in {day}; go on with: palpate runs resume {day}\n"
    assert (said.status, said.err.lstrip("\n")) == (130, f"palpate: interrupted\n{kept}the outputs are off\n")
    assert outputs(benches[0]) == OFF
    assert (Run.open(Path("day")).status, Run.open(Path("day")).points()) == ("stopped", [])


def test_ctrl_c_at_a_question_stops_the_run(palpate: Palpate, lab: str, monkeypatch: pytest.MonkeyPatch) -> None:
    class Console(StringIO):
        def readline(self, _size: int | None = -1) -> str:
            raise KeyboardInterrupt

    monkeypatch.setattr(sys, "stdin", Console())
    assert palpate(*ONE_POINT, "--bench", lab, "--out", "day").status == 130
    assert Run.open(Path("day")).status == "stopped"
