"""`palpate bus replay`: a recorded run done again on the traffic of its log."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
import tomli_w

from palpate.drivers.logs.bus_log import RUN, Link, Packet
from palpate.procedures.lab import open as session
from palpate.procedures.records.run import Run
from palpate.simulators.faults import inject
from tests.procedures.conftest import Palpate
from tests.procedures.test_bus_log import captured

SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.1 s")
LOG = Path("trace.pcapng")


def same_again(palpate: Palpate, monkeypatch: pytest.MonkeyPatch, *command: str) -> tuple[Run, Run]:
    """A run that is logged, and its replay, which needs no bench and has the same points to the byte."""
    said = palpate(*command, "--log", "trace.blf", "--out", "first", "--quiet")
    assert said.status == 0, said.err
    monkeypatch.setattr(session, "simulated_bench", lambda *_: pytest.fail("a replay needs no bench"))
    said = palpate("bus", "replay", "trace.blf", "--out", "second", "--quiet")
    assert (said.status, said.out) == (0, ""), said.err
    first, second = Run.open(Path("first")), Run.open(Path("second"))
    assert first.digest() == second.digest()
    return first, second


def test_a_run_without_an_optional_device_is_replayed_without_it(
    palpate: Palpate, lab: str, closed_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = tomllib.loads(Path(lab).read_text(encoding="utf-8"))
    tables["link"]["far"] = {"kind": "modbus-tcp", "host": "127.0.0.1", "port": closed_port}
    tables["device"]["ring"] = {"kind": "sample_changer", "link": "far", "unit": 1, "optional": True}
    Path(lab).write_text(tomli_w.dumps(tables), encoding="utf-8")
    _, second = same_again(palpate, monkeypatch, *SWEEP, "--bench", lab, "--assume-mounted")
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
    assert (
        [(e["bench_ns"], e["kind"]) for e in first.events()]
        == [(e["bench_ns"], e["kind"]) for e in second.events()]
        != []
    )
    assert (first.summary, first.simulated) == (second.summary, second.simulated)
    assert second.header["replayed"] == "trace.pcapng"
    same = ("procedure", "started", "settings", "scene", "seed", "bench", "calibration")
    assert [first.header[key] for key in same] == [second.header[key] for key in same]


@pytest.mark.slow
def test_a_replayed_calibration_replaces_none(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    weights = ("calibrate", "load-cell", "--loads", "1 N, 2 N, 3 N", "--runs", "2")
    same_again(palpate, monkeypatch, *weights)
    assert Path("second/calibration.toml").exists()
    (kept,) = Path("runs/calibrations").iterdir()
    assert kept.read_bytes() == Path("first/calibration.toml").read_bytes()


# --- what cannot be replayed ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (None, ""), (b"", ""), (bytes(40), ""), ("{}", "bench"), ('{"bench": "", "procedure": 1}', "name"),
        ("[]", "run"), ("{", "run"),
    ],
)  # fmt: skip
def test_what_is_no_log_or_one_of_another_palpate_is_named(
    palpate: Palpate, content: bytes | str | None, name: str
) -> None:
    if isinstance(content, str):
        captured(LOG, [Packet(0, RUN, Link.NOTE, True, content.encode())])
    elif content is not None:
        LOG.write_bytes(content)
    said = palpate("bus", "replay", "trace.pcapng")
    assert (said.status, "trace.pcapng" in said.complaint, name in said.complaint) == (2, True, True)
