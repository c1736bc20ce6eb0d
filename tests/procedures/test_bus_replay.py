"""`palpate bus replay`: a recorded run done again on the traffic of its log."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
import tomli_w

from palpate.drivers.logs.bus_log import RUN, Link, Packet, PcapngWriter, read_pcapng
from palpate.procedures.lab import open as session
from palpate.procedures.records.run import Run
from palpate.simulators.faults import inject
from tests.procedures.conftest import Palpate, Spoken

SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.1 s")
LOG = Path("trace.pcapng")


def nothing_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a replay needs no bench")

    monkeypatch.setattr(session, "simulated_bench", refuse)


def same_again(palpate: Palpate, monkeypatch: pytest.MonkeyPatch, *command: str) -> tuple[Run, Run]:
    """A run that is logged, and its replay."""
    said = palpate(*command, "--log", "trace.blf", "--out", "first", "--quiet")
    assert said.status == 0, said.err
    nothing_simulated(monkeypatch)
    said = palpate("bus", "replay", "trace.blf", "--out", "second", "--quiet")
    assert (said.status, said.out) == (0, ""), said.err
    return Run.open(Path("first")), Run.open(Path("second"))


def test_a_replayed_sweep_has_the_same_points_to_the_byte(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = same_again(palpate, monkeypatch, *SWEEP)
    assert first.digest() == second.digest()


def test_a_run_without_an_optional_device_is_replayed_without_it(
    palpate: Palpate, lab: str, closed_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = tomllib.loads(Path(lab).read_text(encoding="utf-8"))
    tables["link"]["far"] = {"kind": "modbus-tcp", "host": "127.0.0.1", "port": closed_port}
    tables["device"]["ring"] = {"kind": "sample_changer", "link": "far", "unit": 1, "optional": True}
    Path(lab).write_text(tomli_w.dumps(tables), encoding="utf-8")
    first, second = same_again(palpate, monkeypatch, *SWEEP, "--bench", lab, "--assume-mounted")
    assert first.digest() == second.digest()
    assert [event["kind"] for event in second.events()] == ["caution"]


@pytest.mark.slow
def test_a_replay_of_a_noisy_bench_that_failed_once_has_the_same_points_and_incidents(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Transfers over TCP, the line and CAN take their time here, and once the generator does not answer."""
    monkeypatch.setattr(inject, "TIMEOUT", "2 s")  # as outside of tests: what a busy machine delays is no second fault
    scene = Path(session.__file__).parents[2] / "simulators" / "scenes" / "noisy_lab.toml"
    fault = '\n[[fault]]\nkind = "no_reply"\non = "signal_generator"\ntransaction = 12\n'
    Path("faulty.toml").write_text(scene.read_text() + fault)
    first, second = same_again(palpate, monkeypatch, *SWEEP, "--scene", "faulty.toml", "--seed", "3")
    assert first.digest() == second.digest()
    assert (
        [(e["bench_ns"], e["kind"]) for e in first.events()]
        == [(e["bench_ns"], e["kind"]) for e in second.events()]
        != []
    )
    assert (first.summary, first.simulated) == (second.summary, second.simulated)
    assert second.header["replayed"] == "trace.pcapng"
    for key in ("procedure", "started", "settings", "scene", "seed", "bench", "calibration"):
        assert first.header[key] == second.header[key]


@pytest.mark.slow
def test_a_replayed_calibration_replaces_none(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    weights = ("calibrate", "load-cell", "--loads", "1 N, 2 N, 3 N", "--runs", "2")
    first, second = same_again(palpate, monkeypatch, *weights)
    assert first.digest() == second.digest()
    assert Path("second/calibration.toml").exists()
    (kept,) = Path("runs/calibrations").iterdir()
    assert kept.read_bytes() == Path("first/calibration.toml").read_bytes()


# --- what cannot be replayed ---------------------------------------------------------------------------


def failed(said: Spoken, status: int, *names: str) -> None:
    assert said.status == status
    for name in names:
        assert name in said.complaint, said.complaint


@pytest.mark.slow
def test_a_request_that_the_log_does_not_hold_there_is_named_in_one_error(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The log is that of a run with another frequency."""
    palpate(*SWEEP, "--log", "trace.blf", "--quiet")
    packets = list(read_pcapng(LOG))
    with LOG.open("wb") as file:
        writer = PcapngWriter(file)
        for packet in packets:
            settings = packet.data.replace(b'"frequency":10.0', b'"frequency":20.0')
            writer.write(replace(packet, data=settings) if packet.who == RUN else packet)
        writer.end()
    nothing_simulated(monkeypatch)
    asked, held = (f"'node 1 write sync_period = 0.00{period} s'" for period in (2, 4))
    failed(
        palpate("bus", "replay", "trace.blf"),
        2,
        f"trace.pcapng: the replay sends {asked}",
        f"the log goes on with {held}",
    )


@pytest.mark.parametrize("content", [None, b"", bytes(40)])
def test_what_is_no_log_is_named(palpate: Palpate, content: bytes | None) -> None:
    if content is not None:
        LOG.write_bytes(content)
    failed(palpate("bus", "replay", "trace.pcapng"), 2, "trace.pcapng")


@pytest.mark.parametrize(
    ("header", "names"),
    [("{}", "bench"), ('{"bench": "", "procedure": 1}', "name"), ("[]", "run"), ("{", "run")],
)
def test_a_log_of_another_palpate_is_named(palpate: Palpate, header: str, names: str) -> None:
    with LOG.open("wb") as file:
        writer = PcapngWriter(file)
        writer.write(Packet(0, RUN, Link.NOTE, True, header.encode()))
        writer.end()
    failed(palpate("bus", "replay", "trace.pcapng"), 2, "trace.pcapng", names)
