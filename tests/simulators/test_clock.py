"""Virtual time: integer nanoseconds, events in order, and no trace of how a wait was cut."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.sensor_node import Recording
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.own import SYNC_COB_ID, SYNC_PRODUCER
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.loop import LATE, MOST, PIECE, Pacer
from tests.conftest import latched

SECOND = 1_000_000_000


class Metronome:
    """Ticks at every multiple of its period, and writes down what it lives through."""

    def __init__(self, clock: VirtualClock, name: str, period_ns: int, log: list[tuple[str, int]]) -> None:
        self.name, self.period_ns, self.log = name, period_ns, log
        self.clock = clock
        self.stretches: list[tuple[int, int]] = []
        clock.add(self)

    def next_event_ns(self) -> int:
        return (self.clock.now_ns() // self.period_ns + 1) * self.period_ns if self.period_ns else NEVER

    def advance(self, start_ns: int, end_ns: int) -> None:
        assert self.clock.now_ns() == end_ns
        self.stretches.append((start_ns, end_ns))
        if self.period_ns and end_ns % self.period_ns == 0:
            self.log.append((self.name, end_ns))


def test_events_come_in_order_and_those_of_one_moment_in_the_order_of_adding() -> None:
    clock, log = VirtualClock(), []  # type: ignore[var-annotated]
    for name, period in (("slow", 70_000_000), ("fast", 30_000_000), ("idle", 0)):
        Metronome(clock, name, period, log)
    clock.wait(1.0)
    assert [t for _, t in log] == sorted(t for _, t in log)
    assert len(log) == 1000 // 70 + 1000 // 30
    assert [name for name, t in log if t == 210_000_000] == ["slow", "fast"]


def test_all_live_through_every_moment_once() -> None:
    clock = VirtualClock()
    idle = Metronome(clock, "idle", 0, [])
    Metronome(clock, "fast", 30_000_000, [])
    for piece in (0.1, 0.05, 0.0, 0.25):
        clock.wait(piece)
    starts, ends = zip(*idle.stretches, strict=True)
    assert (starts[0], ends[-1]) == (0, 400_000_000)
    assert starts[1:] == ends[:-1]
    assert all(start < end for start, end in idle.stretches)


@pytest.mark.parametrize(("duration", "expected"), [(1.001, 1_001_000_000), (0.6e-9, 1), (0.4e-9, 0), (0.0, 0)])
def test_a_wait_is_rounded_to_the_nearest_nanosecond(duration: float, expected: int) -> None:
    clock = VirtualClock()
    clock.wait(duration)
    assert clock.now_ns() == expected


def test_ten_thousand_short_waits_are_one_long_one() -> None:
    clock = VirtualClock()
    for _ in range(10_000):
        clock.wait(1e-4)
    assert clock.now_ns() == SECOND


@pytest.mark.parametrize("duration", [-1e-9, -1.0, float("nan"), float("inf"), -float("inf")])
def test_a_negative_or_not_finite_wait_is_refused_and_time_stands(duration: float) -> None:
    clock = VirtualClock()
    clock.wait(1.0)
    with pytest.raises(ValueError, match=rf"cannot wait {duration} s; a wait is finite and not negative"):
        clock.wait(duration)
    assert clock.now_ns() == SECOND


def test_the_scene_moves_on_under_the_lock_only() -> None:
    clock, entered = VirtualClock(), []

    class Watcher(Metronome):
        def advance(self, start_ns: int, end_ns: int) -> None:
            other = threading.Thread(target=lambda: entered.append(clock.lock.acquire(blocking=False)))
            other.start()
            other.join()

    Watcher(clock, "watcher", 0, [])
    clock.wait(1.0)
    assert entered == [False]


def test_with_a_pace_waits_take_the_time_of_the_wall_and_make_up_for_what_computing_took(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The wall's clock is played: computing takes 2 s of it in the middle."""
    wall = [100.0]
    played = SimpleNamespace(monotonic=lambda: wall[0], sleep=lambda seconds: wall.append(wall.pop() + seconds))
    monkeypatch.setattr("palpate.simulators.clock.time", played)
    clock = VirtualClock()
    clock.wait(10.0)
    assert wall == [100.0]
    clock.pace = 2.0
    clock.wait(3.0)
    assert wall == pytest.approx([101.5])
    wall[0] += 2.0
    clock.wait(1.0)
    assert wall == pytest.approx([103.5])
    clock.wait(6.0)
    assert wall == pytest.approx([105.0])


# --- a pacer -----------------------------------------------------------------------------------------

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
    address, blocked, turn = sim.description.links["shaker_amplifier"], threading.Event(), threading.Event()

    def other_program() -> None:
        """Another program has the processor."""
        blocked.set()
        turn.wait(10)

    with socket.create_connection((address.host, address.port), timeout=10) as client:
        client.sendall(READ)
        assert client.recv(64)
        before = sim.servers.transactions
        sim.servers.loop.at(0.0, other_program)
        client.sendall(READ)  # wakes the server, which answers it before or after the other program
        assert blocked.wait(10)
        client.sendall(READ)
        threading.Timer(0.0, turn.set).start()
        sim.servers.catch_up()
        assert sim.servers.transactions == before + 2


# --- the whole bench ---------------------------------------------------------------------------------


def everything(contract: Contract, read: Callable[[str], float]) -> bytes:
    return b"".join(contract.pack(f.name, read(f.name)) for f in contract.fields if f.access != "wo")


def live(scene: Scene, pieces: int) -> tuple[Recording, list[bytes]]:
    """0.7 s in which a move ends, a tare is taken, a watchdog trips and a node samples; then all that can be read."""
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        bench.operator.mount(SAMPLES["4"])
        bench.device("positioner").move(18e-3, speed=5e-3)
        bench.drive()
        bench.device("signal_generator").sine(10.0, 2.5)
        bench.device("shaker_amplifier").configure(gain=2.0, current_limit=5.0, watchdog=0.333)
        bench.device("strain_indicator").peak_to_peak(0.25)
        bench.device("positioner").set(target=18.3e-3, speed=1.1e-3, command="move")
        bench.device("strain_indicator").set(command="clear_tare")
        node = bench.device("sensor_node_1")
        node.arm()
        node.set("sync_cob_id", SYNC_PRODUCER | SYNC_COB_ID)
        for _ in range(pieces):
            sim.clock.wait(0.7 / pieces)
        assert node.get("sample_counter") == 700
        assert latched(sim) == {"watchdog"}
        recording = node.collect(700)
        devices = (sim.generator, sim.amplifier, sim.indicator, sim.positioner)
        state = [everything(device.contract, device.read) for device in devices]
        return recording, [*state, sim.amplifier.read("temperature").hex().encode()]


def test_a_wait_gives_the_same_however_it_is_cut(scene: Scene) -> None:
    (recording, whole), *others = (live(scene, pieces) for pieces in (1, 7, 70))
    for cut_recording, cut in others:
        assert cut == whole
        assert cut_recording.voltage.tobytes() == recording.voltage.tobytes()
