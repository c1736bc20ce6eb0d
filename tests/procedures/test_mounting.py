"""What a person mounts or places on a real bench is confirmed by its name, or assumed where he said so."""

from __future__ import annotations

import itertools
import sys
import tomllib
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from palpate import PositionSweep, Run, TemperatureSweep, UsageError
from palpate.extend import Procedure
from palpate.procedures.lab import operator
from palpate.procedures.lab.chosen import choose
from palpate.procedures.lab.operator import Mounting, at_terminal, weaker
from palpate.procedures.showing.text import where
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import Benches, Palpate, refused

SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s")
BY_HAND = {
    ("sweep", "loads"): "mounts the samples",
    ("sweep", "position"): "sets the point probe",
    ("sweep", "temperature"): "warms the sensor",
    ("sweep", "frequency"): "mounts the samples",
    ("calibrate", "load-cell"): "places the weights",
    ("calibrate", "films"): "stands the pin on the teeth",
    ("test", "modulus", "--sample", "1"): "lays the sample on the support",
    ("characterise",): "mounts the samples",
    ("softness", "--samples", "1"): "mounts the samples",
}


@pytest.fixture
def headless(lab: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """The bench file of `lab`, with nobody at its console."""
    monkeypatch.setattr(operator, "at_terminal", at_terminal)
    monkeypatch.setattr(sys, "stdin", StringIO("1\n" * 99))
    return lab


def test_without_a_terminal_nothing_is_asked_of_a_bench_on_which_nobody_could_confirm(
    palpate: Palpate, headless: str, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    for (command, work), console in zip(BY_HAND.items(), itertools.cycle([StringIO("1\n" * 99), None])):
        monkeypatch.setattr(sys, "stdin", console)
        design = "common_base" if "position" in command else "single"
        Path(headless).write_text(
            sim.description.patient().model_copy(update={"design": design}).to_toml(), encoding="utf-8"
        )
        said = palpate(*command, "--bench", headless)
        assert (said.status, sim.servers.transactions) == (2, 0)
        assert said.complaint.startswith(
            f"a person {work} on this bench and has to confirm it, but standard input is no terminal"
        )
        assert "--assume-mounted" in said.complaint
        assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("procedure", "there", "mounting"),
    [
        (TemperatureSweep, {"sample_changer", "chamber"}, "sample changer"),
        (TemperatureSweep, {"sample_changer", "probe_stage"}, "a person warms the sensor on"),
        (TemperatureSweep, {"chamber"}, "a person mounts the samples on"),
        (PositionSweep, {"sample_changer", "probe_stage"}, "sample changer"),
        (PositionSweep, {"sample_changer", "chamber"}, "a person sets the point probe on"),
    ],
)
def test_nobody_has_to_confirm_the_work_of_a_device(
    procedure: type[Procedure[Any, Any, Any]], there: set[str], mounting: str, headless: str
) -> None:
    chosen = choose(Path(headless))
    try:
        found: str = chosen.mounting(procedure.manual_work, procedure.automated_by, there.__contains__)
    except UsageError as error:
        found = str(error)
    assert found.startswith(mounting)


def test_a_changer_that_is_absent_mounts_nothing(palpate: Palpate, headless: str, closed_port: int) -> None:
    tables = tomllib.loads(Path(headless).read_text(encoding="utf-8"))
    changer = {"kind": "sample_changer", "link": "changer", "unit": 1, "optional": True}
    link = {"kind": "modbus-tcp", "host": "127.0.0.1", "port": closed_port}
    tables["link"]["changer"], tables["device"]["ring"] = link, changer
    Path(headless).write_text(tomli_w.dumps(tables), encoding="utf-8")
    said = palpate(*SWEEP, "--bench", headless)
    assert (said.status, said.complaint.split(" and")[0]) == (2, "a person mounts the samples on this bench")


def test_what_is_assumed_is_told_by_the_record_the_report_and_json(palpate: Palpate, headless: str) -> None:
    said = palpate(*SWEEP, "--bench", headless, "--assume-mounted", "--out", "first", "--json")
    assert (said.err, said.object["mounting"]) == (
        "assumed, as --assume-mounted asks: Mount sample 1 (white silicone rubber, 3 mm)\n",
        "assumed",
    )
    assert where(said.object, Path("plot.png"))[1] == "mounting       ASSUMED, nobody has confirmed it"
    assert Run.open(Path("first")).header["mounting"] == "assumed"
    assert "mounting     ASSUMED, nobody has confirmed it\n" in palpate("runs", "show", "first").out


@pytest.mark.parametrize(
    ("before", "now", "whole"),
    [
        ("confirmed", "confirmed", "confirmed"),
        ("confirmed", "assumed", "assumed"),
        ("assumed", "confirmed", "assumed"),
        ("confirmed", "sample changer", "confirmed"),
        ("sample changer", "confirmed", "confirmed"),
        (None, "sample changer", "assumed"),
        (None, "simulated", "simulated"),
    ],
)
def test_a_run_that_goes_on_knows_what_was_mounted_as_in_its_less_certain_part(
    before: str | None, now: Mounting, whole: Mounting
) -> None:
    assert weaker(before, now) == whole


def test_a_simulated_bench_assumes_nothing(palpate: Palpate, benches: Benches) -> None:
    assert "leave it out or give --bench" in refused(palpate(*SWEEP, "--assume-mounted"), benches)


def test_another_name_than_that_of_the_sample_is_no_answer(
    palpate: Palpate, lab: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", StringIO("\n2\ny\n 1 \n"))
    said = palpate(*SWEEP, "--bench", lab)
    assert said.status == 0
    wrong = [line.split(" is not ")[0] for line in said.err.splitlines()[1:]]
    assert wrong == ["''", "'2'", "'y'"]


def test_nobody_left_at_the_console_ends_the_run(palpate: Palpate, lab: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", StringIO(""))
    said = palpate(*SWEEP, "--bench", lab)
    assert said.status == 1
    assert "run palpate in a terminal" in said.err
