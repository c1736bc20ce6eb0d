"""A served bench on a busy machine: its time goes on only when what came in time has been answered."""

from __future__ import annotations

import socket
import threading

import pytest

from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.wire.loop import LATE, MOST, PIECE, Pacer

READ = bytes.fromhex("0007 0000 0006 01 03 0000 0002")  # of the word-order probe


@pytest.mark.parametrize(
    ("passed", "speed", "done"),
    [
        (LATE / 2, 1.0, ["0.005 s"]),
        (2 * LATE, 1.0, ["answered", "0.02 s"]),
        (2.5 * PIECE, 2.0, ["answered", "0.0833333 s"] * 3),
        (2 * MOST, 1.0, ["answered", "0.05 s"] * 10),
    ],
)
def test_a_pacer_that_comes_late_lets_requests_be_answered_before_time_goes_on(
    passed: float, speed: float, done: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, seen = VirtualClock(), list[str]()
    monkeypatch.setattr(clock, "wait", lambda duration: seen.append(f"{duration:g} s"))
    pacer = Pacer(clock, speed, lambda _error: None, lambda: seen.append("answered"))
    pacer.turn(passed)
    assert seen == done
    assert pacer.behind == pytest.approx(max(0.0, passed - MOST))


def test_what_has_come_is_answered_though_the_server_had_no_turn_meanwhile(sim: SimulatedBench) -> None:
    address, turn = sim.description.links["shaker_amplifier"], threading.Event()
    with socket.create_connection((address.host, address.port), timeout=10) as client:
        client.sendall(READ)
        assert client.recv(64)
        sim.servers.loop.at(0.0, turn.wait)  # another program has the processor
        client.sendall(READ)
        assert client.recv(64)
        before = sim.servers.transactions
        client.sendall(READ)
        threading.Timer(0.0, turn.set).start()
        sim.servers.catch_up()
        assert sim.servers.transactions == before + 1
