"""`palpate serve`: the bench of one process, for the clients of another; faults that are typed, and plain masters."""

from __future__ import annotations

import math
import os
import re
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from io import StringIO
from itertools import pairwise
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import can
import pytest
from can.interfaces.udp_multicast.bus import GeneralPurposeUdpMulticastBus
from rich.console import Console

from palpate import Run, get_sample
from palpate.drivers.clock import WallClock
from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink
from palpate.extend import Bench, DeviceError, ModbusDevice, Scene, read_bench
from palpate.instrument.bench import links
from palpate.instrument.bench.links import MULTICAST, keep_to_group
from palpate.instrument.calibration.load_cell import STANDARD_GRAVITY
from palpate.instrument.contracts.field import PROBE
from palpate.instrument.contracts.own import SHAKER_AMPLIFIER as AMPLIFIER
from palpate.instrument.errors import BenchError, ConfigError, LinkError, PalpateError, UsageError
from palpate.procedures.console.terminal import Progress
from palpate.procedures.lab import open as session
from palpate.procedures.virtual.served_bench import (
    Person,
    TransactionRate,
    Wish,
    serve_until_told,
    serving,
    state_of,
    status,
)
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.fault import places, struck
from palpate.simulators.planning.settle import with_faults
from palpate.simulators.scenes.heads import shipped
from palpate.simulators.wire.can_bus import own_channel
from tests.conftest import hasty
from tests.procedures.conftest import Palpate, Spoken, happens_in

STANDING = 1.0  # s of an Enter, in a bench whose time stands still otherwise


@pytest.fixture
def wish(scene: Scene) -> Wish:
    return Wish(scene, BenchAddresses(), None, 1.0, STANDING, (), None)


@contextmanager
def typing(text: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A console at which somebody has typed this; its end never comes."""
    read, write = os.pipe()
    os.write(write, text.encode())
    with os.fdopen(read) as console:
        monkeypatch.setattr(sys, "stdin", console)
        yield
    os.close(write)


@pytest.fixture
def quiet(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Spoken]:
    """Serves a scene while some lines are typed."""

    def serve(text: str, *words: str) -> Spoken:
        with typing(text, monkeypatch):
            return palpate("serve", *(words or ("thesis_single", "--can", "virtual", "--quiet")))

    return serve


@contextmanager
def swept(wish: Wish, monkeypatch: pytest.MonkeyPatch, samples: str, place: str) -> Iterator[None]:
    """Serves a bench with a sample changer; its clients have the bench's wall clock, so that nobody waits."""
    monkeypatch.setattr(sys, "stdin", None)
    with serving(replace(wish, samples=tuple(map(get_sample, samples)), out=Path(place))) as served:
        monkeypatch.setattr(session, "WallClock", lambda _begun: served.sim.clock)
        yield


def seen_at_the_end(look: Callable[[SimulatedBench], bool], monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """What is seen of a bench before it is closed."""
    was: list[bool] = []
    leave = SimulatedBench.__exit__

    def exit_(sim: SimulatedBench, *error: Any) -> None:
        was.append(bool(look(sim)))
        leave(sim, *error)

    monkeypatch.setattr(SimulatedBench, "__exit__", exit_)
    return was


@pytest.mark.slow
def test_a_sweep_that_is_interrupted_finds_each_sample_by_its_name_when_it_is_run_again_or_resumed(
    palpate: Palpate, wish: Wish, monkeypatch: pytest.MonkeyPatch, on_progress: Callable[[Progress], None]
) -> None:
    """A bench of its own, with other noise, says what is to be found."""
    sweep = ("sweep", "loads", "--samples", "1,2", "--loads", "2 N", "--dwell", "0.2 s", "--json")
    alone = palpate(*sweep, "--seed", "5").object["samples"]
    moments = [KeyboardInterrupt]

    def interrupt(_done: int, _total: int, what: str) -> None:
        if what.startswith("sample 2") and moments:
            raise moments.pop()

    on_progress(interrupt)
    with swept(wish, monkeypatch, "123", "bench.toml"):
        assert palpate(*sweep, "--bench", "bench.toml", "--out", "cut").status == 130
        again = palpate(*sweep, "--bench", "bench.toml").object
        resumed = palpate("runs", "resume", "cut", "--json").object
    assert again["simulated"] and resumed["simulated"]
    for found in (again, resumed):
        for one, other in zip(found["samples"], alone, strict=True):
            apart = 3 * math.hypot(one["force_ratio_u"], other["force_ratio_u"])
            assert one["force_ratio"] == pytest.approx(other["force_ratio"], abs=apart)


def test_the_bench_file_of_a_run_or_of_a_person_is_not_overwritten_and_that_of_an_earlier_served_bench_is(
    palpate: Palpate, wish: Wish
) -> None:
    earlier, own = Path("run/bench.toml"), Path("my_bench.toml")
    earlier.parent.mkdir()
    for _ in range(2):
        with serving(replace(wish, out=earlier)) as served:
            assert earlier.read_text(encoding="utf-8") == served.description.to_toml()
    Path("run/run.record").touch()
    files = [(earlier, served.description.to_toml(), "run/bench.toml belongs to a run; choose another --out")]
    exists = "my_bench.toml exists, and palpate serve did not write it; choose another --out"
    for file, text, why in (*files, *((own, text, exists) for text in ('name = "my bench"\n', "", "\xff"))):
        file.write_text(text, encoding="latin-1")
        refused = palpate("serve", "ideal", "--can", "virtual", "--out", str(file))
        assert (refused.status, refused.complaint, file.read_text(encoding="latin-1")) == (2, why, text)


def test_a_bench_whose_amplifier_anybody_feeds_says_so_before_it_drives_and_in_its_record(
    palpate: Palpate, wish: Wish, monkeypatch: pytest.MonkeyPatch, on_progress: Callable[[Progress], None]
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    on_progress(interrupt)
    with swept(wish, monkeypatch, "1", "b.toml"):
        place = Path("b.toml")
        place.write_text(place.read_text().replace('watchdog_fed_by = "owner"', 'watchdog_fed_by = "any request"'))
        said = palpate("sweep", "loads", "--samples", "1", "--bench", "b.toml", "--out", "run")
    assert said.status == 130
    assert re.match("palpate: note: shaker amplifier at .*: any request feeds its watchdog", said.err)
    assert Run.open(Path("run")).events()[0]["kind"] == "caution"


@pytest.mark.parametrize(
    ("line", "seen"),
    [
        ("mount 3", lambda sim: sim.rig.sample == get_sample("3")),
        ("lay none", lambda sim: sim.rig.mounted.on_support),
        ("weight 240 g", lambda sim: sim.rig.weight == pytest.approx(0.24 * STANDARD_GRAVITY)),
        ("turn 90", lambda sim: sim.rig.cell_position == 90.0),
    ],
)
def test_what_a_person_does_is_typed(
    quiet: Callable[..., Spoken], monkeypatch: pytest.MonkeyPatch, line: str, seen: Callable[[SimulatedBench], bool]
) -> None:
    was = seen_at_the_end(seen, monkeypatch)
    said = quiet(f"{line}\nquit\n")
    assert (said.status, said.out, said.err, was) == (0, "", f"done: {line}\n", [True])


MISTYPED = (
    *("mount", "mount 9", "weight heavy", "weight -5 g", "probe 1 mm", "tooth 2", "tooth 1.5", "turn 1e9"),
    *("warm 1e9 K", "dance", "mount '1", "fault line", "clear all"),
)


def test_a_mistyped_line_is_said_and_stops_nothing(quiet: Callable[..., Spoken]) -> None:
    said = quiet("\n".join((*MISTYPED, "turn 90", "quit\n")))
    *wrong, done = said.err.splitlines()
    assert (said.status, done, len(wrong)) == (0, "done: turn 90", len(MISTYPED))
    assert all(each.startswith("palpate: ") for each in wrong)


@pytest.mark.parametrize(
    ("number", "handler", "goes_on"),
    [
        (signal.SIGHUP, signal.SIG_IGN, True),
        (signal.SIGHUP, signal.SIG_DFL, False),
        (signal.SIGINT, signal.SIG_IGN, False),  # as a script starts it in the background
        (signal.SIGTERM, signal.SIG_DFL, False),
    ],
)
def test_a_signal_ends_a_served_bench_but_for_a_hang_up_that_it_was_started_to_ignore(
    number: signal.Signals, handler: signal.Handlers, goes_on: bool, quiet: Callable[..., Spoken],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(Person, "do", lambda _person, _line: os.kill(os.getpid(), number))
    before = signal.signal(number, handler)
    try:
        said = quiet("signal\nquit\n")
        assert signal.getsignal(number) == handler
    finally:
        signal.signal(number, before)
    assert (said.status, said.err) == (0, "done: signal\n" if goes_on else "")


def test_json_says_where_everything_is(quiet: Callable[..., Spoken]) -> None:
    options = ("--seed", "3", "--can", "virtual:mine", "--line", "line", "--out", "b.toml", "--json")
    found = quiet("quit\n", "thesis_single", *options).object
    assert (found["scene"], found["seed"], found["speed"], found["bench_file"]) == ("thesis_single", 3, 1.0, "b.toml")
    assert found["bench"] == read_bench(Path("b.toml")).model_dump(mode="json")
    assert found["bench"]["link"]["can"]["channel"] == "mine"
    assert found["bench"]["link"]["line"]["port"] == str(Path("line").absolute())
    assert not Path("line").is_symlink()


def test_the_watchdog_of_a_fast_bench_counts_the_time_of_its_clients(wish: Wish) -> None:
    with serving(replace(wish, speed=10.0)) as served:
        amplifier, clock = served.sim.amplifier, served.sim.clock
        amplifier.write({"watchdog": 2.0, "enable": 1.0})
        amplifier.requested()
        clock.wait(19.9)
        assert amplifier.settings["enable"]
        clock.wait(0.2)
        assert not amplifier.settings["enable"]


@pytest.mark.slow
def test_a_stranger_cannot_tell_the_owners_ticket_from_his_own(wish: Wish) -> None:
    with serving(wish) as served:
        link = ModbusLink.tcp(served.description.links["shaker_amplifier"])
        link.open()
        amplifier = ModbusDevice(link, 1, served.sim.clock, AMPLIFIER)
        owners = int(amplifier.get("ticket"))
        amplifier.set(token=owners, counter=1)
        tickets = [int(amplifier.get("ticket")) for _ in range(3)]
        steps = {(later - before) % 2**32 for before, later in pairwise(tickets)}
        for step in steps:  # one that is constant leads from his first ticket to the owner's
            with pytest.raises(DeviceError, match="device busy"):
                amplifier.set(release=(tickets[0] - step) % 2**32)
        assert amplifier.get("status") == 2.0  # it is still owned
        link.close()


def test_a_name_for_the_line_leads_to_its_terminal(wish: Wish, tmp_path: Path) -> None:
    with serving(replace(wish, line=tmp_path / "line")) as served:
        assert str((tmp_path / "line").readlink()) == served.sim.description.links["line"].port


def test_a_scene_file_that_changes_while_it_is_served_changes_nothing(
    quiet: Callable[..., Spoken], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = Path("mine.toml")
    file.write_text((shipped()["thesis_single"]).read_text())

    def spoilt(sim: SimulatedBench) -> bool:
        file.write_text("rubbish")
        sim.clock.wait(1.0)
        with Bench(sim.description, sim.clock, sim.operator) as bench:
            return bench.simulated

    was = seen_at_the_end(spoilt, monkeypatch)
    said = quiet("quit\n", "mine.toml", "--can", "virtual", "--quiet")
    assert (said.status, said.err, was) == (0, "", [True])
    assert "mine.toml" in quiet("quit\n", "mine.toml", "--can", "virtual").complaint


# --- time ----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_program_that_neither_waits_nor_asks_for_three_time_outs_does_not_trip_the_watchdog(wish: Wish) -> None:
    with serving(replace(wish, step=None)) as served:
        description = served.description.model_copy(update={"watchdog": 1.0})
        clock = served.sim.clock
        with Bench(description, WallClock(), served.sim.operator) as bench:
            bench.drive()
            end = clock.now_ns() + 3e9
            while clock.now_ns() < end:  # it computes
                pass
            bench.clock.wait(0.0)
            assert served.sim.amplifier.settings["enable"]


def test_enter_moves_a_bench_on_whose_time_stands_still(wish: Wish, monkeypatch: pytest.MonkeyPatch) -> None:
    passed: list[float] = []
    monkeypatch.setattr(VirtualClock, "wait", lambda _clock, duration: passed.append(duration))
    with typing("\n\nquit\n", monkeypatch):
        serve_until_told(wish, lambda _bench: None, shows_status=False)
    assert passed == [STANDING, STANDING]


def test_time_goes_on_by_itself_and_stops_at_the_end(wish: Wish) -> None:
    reached = threading.Event()
    with serving(replace(wish, step=None, speed=20.0)) as served:
        happens_in(served.sim, 1.0, reached.set)
        assert reached.wait(30)
    then = served.sim.clock.now_ns()
    assert then >= 1_000_000_000
    assert served.sim.clock.now_ns() == then


def test_a_scene_that_fails_ends_the_serving_with_its_reason(
    quiet: Callable[..., Spoken], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_clock: VirtualClock, _duration: float) -> None:
        raise ArithmeticError("the chain flies apart")

    monkeypatch.setattr(VirtualClock, "wait", fail)
    said = quiet("")
    assert said.status == 1
    assert said.complaint.startswith("the simulation has failed: the chain flies apart; serve the bench again")


def test_the_page_shows_outputs_readings_faults_and_traffic(wish: Wish) -> None:
    with serving(wish) as served:
        sim, port = served.sim, served.description.links["signal_generator"].port
        sim.generator.write({"amplitude": 0.5, "frequency": 20.0, "output": 1.0})
        sim.amplifier.trip("watchdog")
        traffic = TransactionRate(sim)
        traffic.rate(1.0)
        with socket.create_connection(("127.0.0.1", port)) as client:
            for _ in range(6):
                client.sendall(bytes.fromhex("0001 0000 0006 01 03 7000 0001"))
                assert client.recv(100)
        console = Console(width=100, record=True, file=StringIO())
        console.print(status(sim, state_of(sim, traffic.rate(3.0), 0.0)))
    page = " ".join(console.export_text().split())
    shown = ("SIMULATED", "on, 500 mV at 20 Hz", "latched watchdog", "1 pre-operational", "of 1 Mbit/s at worst",
             "3 transactions/s", "mV")  # fmt: skip
    assert [text for text in shown if text not in page] == []


# --- what cannot be served -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "status", "names"),
    [
        (("--can", "nonsense:0"), 1, "nonsense:0"),
        (("--can", "kvaser:0"), 1, "kvaser:0"),
        (("--can", "udp_multicast:10.0.0.1"), 1, "udp_multicast:10.0.0.1"),
        (("--can", "virtual", "--listen", "192.0.2.1"), 1, "192.0.2.1"),
        (
            ("--can", "virtual", "--port", "TAKEN"),
            1,
            ": the port is in use, or the host is no address of this machine;",
        ),
        (("--can", "virtual", "--speed", "0"), 2, "--speed 0"),
        (("--can", "virtual", "--speed", "nan"), 2, "--speed nan"),
        (("--can", "virtual", "--step", "0 s"), 2, "--step 0 s"),
        (("--can", "virtual", "--step", "fast"), 2, "fast"),
        (("--can", "virtual", "--line", "."), 2, "--line ."),
        (("--can", "virtual", "--samples", "7"), 2, "7"),
        (("--can", "virtual", "--out", "no/where.toml"), 1, "no/where.toml"),
    ],
)
def test_what_cannot_be_served_is_named_and_nothing_is_left(
    palpate: Palpate, options: tuple[str, ...], status: int, names: str
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        said = palpate("serve", "thesis_single", *(port if each == "TAKEN" else each for each in options))
    assert said.status == status
    assert names in said.complaint


# --- A served bench: faults that are typed, and its CAN bus for plain masters --------------------------


@pytest.fixture
def bench(sim: SimulatedBench) -> Any:
    """A client that is there already when a fault comes, and does not wait long."""
    with Bench(hasty(sim.description), sim.clock, sim.operator) as opened:
        yield opened


def answer(person: Person, typed: str) -> str:
    found = person.do(typed)
    assert found is not None
    return found


def read_generator(bench: Bench) -> object:
    return bench.device("signal_generator").read()


def read_indicator(bench: Bench) -> object:
    bench.clock.wait(0.5)
    return bench.device("strain_indicator").read().sick


def record(bench: Bench) -> object:
    found = bench.device("sensor_node_1").acquire(0.05)
    return bool(found.saturated.any())


def amplifier_has_latched(bench: Bench) -> object:
    latched = bench.device("shaker_amplifier").read().faults_latched
    bench.device("shaker_amplifier").clear_faults()
    return set(latched)


MET: dict[str, tuple[Callable[[Bench], object], object]] = {
    "signal_generator device_busy": (read_generator, BenchError),
    "signal_generator connection_refused": (read_generator, LinkError),
    "signal_generator wrong_count": (read_generator, BenchError),
    "positioner silence": (lambda bench: bench.device("positioner").position(), LinkError),
    "line two_replies": (lambda bench: bench.device("positioner").position(), 0.0),
    "can lost_frame": (lambda bench: bench.device("sensor_node_1").get("serial"), LinkError),
    "shaker_amplifier over_temperature": (amplifier_has_latched, {"over_temperature"}),
    "strain_indicator bridge_open": (read_indicator, "bridge open"),
    "sensor_node_1 saturated_film channel=1": (record, True),
}


MORE = {"front_panel": " setting=frequency value=5"}
WAITED = {"positioner silence", "can lost_frame"}  # for an answer that never comes


@pytest.mark.parametrize(
    "typed", [pytest.param(typed, marks=[pytest.mark.slow] if typed in WAITED else []) for typed in MET]
)
def test_a_fault_begins_as_it_is_typed_and_ends_as_it_is_cleared(sim: SimulatedBench, bench: Bench, typed: str) -> None:
    person, (look, expected) = Person(sim), MET[typed]
    on, kind, *_ = typed.split()
    bench.device("sensor_node_1").set_sample_rate(1000.0)
    before = look(bench)
    sim.clock.wait(1.0)
    assert person.do(f"fault {typed}") is None
    if isinstance(expected, type):
        with pytest.raises(expected):
            look(bench)
    else:
        assert look(bench) == expected
    assert answer(person, "faults").startswith(f"{on} {kind} ")
    assert answer(person, f"clear {on} {kind}").startswith(f"cleared: {on} {kind} ")
    assert (person.do("faults"), look(bench)) == ("no fault is given", before)


def test_every_fault_can_be_given_and_taken_away_by_hand(sim: SimulatedBench, bench: Bench) -> None:
    """Nobody asks anything meanwhile; what a device has lost with its power is written again."""
    person = Person(sim)
    sim.clock.wait(1.0)
    for kind in FAULTS:
        place = next(iter(struck(fault_class(kind).targets, places(1))))
        person.do(f"fault {place} {kind}{MORE.get(kind, '')}")
        sim.clock.wait(0.01)
        person.do("clear all")
    bench.device("shaker_amplifier").clear_faults()
    bench.recover()
    bench.check_settings()


def test_several_are_told_apart_and_cleared_by_place_or_all_at_once(scene: Scene, nothing_left_behind: None) -> None:
    """Those of the scene, too."""
    with SimulatedBench(with_faults(scene, [{"kind": "bridge_open", "on": "strain_indicator", "at": "1 s"}])) as sim:
        person = Person(sim)
        for typed in ("line bit_error probability=0.5", "positioner silence transaction=9", "can error_frame"):
            person.do(f"fault {typed}")
        assert answer(person, "faults").splitlines() == [
            "strain_indicator bridge_open at=1 s: has struck 0 times",
            "line bit_error probability=0.5: has struck 0 times",
            "positioner silence transaction=9: has struck 0 times",
            "can error_frame at=0 s lasts=until it is cleared: has struck 0 times",
        ]
        sim.clock.wait(2.0)
        assert answer(person, "clear strain_indicator").endswith("has struck once")
        assert "read" not in vars(sim.indicator)
        person.do("clear positioner")
        assert len(answer(person, "faults").splitlines()) == 2
        person.do("clear all")
        assert person.do("faults") == "no fault is given"


WRONG: list[tuple[str, type[PalpateError], str]] = [
    ("fault", UsageError, "needs a PLACE and a KIND"),
    ("fault shaker_amplifier", UsageError, "needs a PLACE and a KIND"),
    ("fault shaker_amplifier over_temp", ConfigError, "fault: unknown fault 'over_temp' (did you mean"),
    ("fault amplifier over_current", ConfigError, "unknown place of a over_current 'amplifier'"),
    ("fault sensor_node_9 emergency", ConfigError, "'sensor_node_9'"),
    ("fault line silence 2s", UsageError, "'2s' is no NAME=VALUE"),
    ("fault line silence kind=x", UsageError, "given twice"),
    ("fault line silence lasts=5", ConfigError, "lasts: 5 needs a unit"),
    ("fault line silence lasts='-1 s'", ConfigError, "lasts: "),
    ("fault line silence probability=2", ConfigError, "probability: "),
    ("fault line silence at=1s transaction=2", ConfigError, "exactly one says when"),
    ("fault line silence often=2", ConfigError, "often: unknown key"),
    ("fault positioner front_panel setting=colour value=1", ConfigError, "colour"),
    ("fault line 'silence", UsageError, "close the quotation"),
    ("fault strain_indicator zero_drift", ConfigError, "has bridge_open already; clear that first"),
    ("fault strain_indicator bridge_open", ConfigError, "has bridge_open already; clear that first"),
    ("fault sample_changer power_cycle", ConfigError, "this bench has no sample_changer"),
    ("clear", UsageError, "and perhaps a KIND, or all"),
    ("clear line silence", UsageError, "there is no such fault; there are: strain_indicator bridge_open"),
    ("clear a b c", UsageError, "and perhaps a KIND, or all"),
    ("faults all", UsageError, "takes no argument, not 1"),
]


def test_what_is_wrong_with_a_typed_fault_is_said_and_nothing_is_changed(sim: SimulatedBench, scene: Scene) -> None:
    """A scene with a fault on a sample changer that the bench does not have is refused as well."""
    person = Person(sim)
    person.do("fault strain_indicator bridge_open")
    for typed, error, says in WRONG:
        with pytest.raises(error) as told:
            person.do(typed)
        assert says in str(told.value)
        assert len(sim.injection.given) == 1
    faulty = with_faults(scene, [{"kind": "no_reply", "on": "sample_changer", "at": "1 s"}])
    with pytest.raises(ConfigError, match="this bench has no sample_changer"), SimulatedBench(faulty):
        pass


# --- the CAN bus of a served bench on UDP multicast, for a plain master of another process ------------

PORT = 43113  # of python-can's multicast buses


@pytest.fixture
def on_multicast(scene: Scene, nothing_left_behind: None) -> Wish:
    return Wish(scene, BenchAddresses(interface=MULTICAST), None, 1.0, 1.0, (), None)


@contextmanager
def plain_bus(channel: str) -> Iterator[can.BusABC]:
    with can.Bus(interface=MULTICAST, channel=channel, hop_limit=0) as bus:
        keep_to_group(bus)
        yield bus


def test_a_plain_can_master_on_multicast_sees_each_sync_sampled_once(on_multicast: Wish) -> None:
    """The server's own SYNC comes back to it there, and is none of the master's."""
    with serving(on_multicast) as served:
        channel = served.description.links["can"].channel
        with plain_bus(channel) as bus:
            answers = _Answers(bus)
            answers.ask(0x601, "2f 00 00 00 00 00 00 00", 0x581)  # no such object
            bus.send(_frame(0x000, "01 01"))
            answers.ask(0x601, "23 05 10 00 80 00 00 40", 0x581)  # produces SYNC
            served.sim.clock.wait(3e-3)
            answers.ask(0x601, "23 05 10 00 80 00 00 00", 0x581)
            bus.send(_frame(0x080, ""))
            answers.until(0x281)
            counters = [int.from_bytes(m.data[:4], "little") for m in answers.heard if m.arbitration_id == 0x281]
            while counters[-1] < 4:
                counters.append(int.from_bytes(answers.until(0x281).data[:4], "little"))
    assert counters == [1, 2, 3, 4]


def send_rubbish(channel: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as rude:
        rude.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        for data in (b"", b"\xc1\xc1", b"\x93\x01", b"\x81\xa3dlc\x63", bytes(5000)):
            rude.sendto(data, (channel, PORT))


def test_rubbish_on_multicast_ends_neither_the_bench_nor_its_client_nor_a_plain_master(on_multicast: Wish) -> None:
    with serving(on_multicast) as served:
        channel = served.description.links["can"].channel
        link = CanLink(served.description.links["can"])
        link.open()
        node = link.add_node(1)
        for _ in range(3):
            send_rubbish(channel)
            assert link.upload("it", node, 0x2000, 0) == PROBE.to_bytes(4, "little")
        link.close()
        with plain_bus(channel) as bus:
            send_rubbish(channel)
            for data in ("", "01", "40 00 10"):
                bus.send(_frame(0x000, data[:2]))
                bus.send(_frame(0x601, data))
            answer = _Answers(bus).ask(0x601, "40 00 20 00 00 00 00 00", 0x581)
    assert answer == f"43002000{PROBE.to_bytes(4, 'little').hex()}"


def test_frames_of_another_bench_that_come_while_a_bus_is_opened_are_not_heard(
    monkeypatch: pytest.MonkeyPatch, nothing_left_behind: None
) -> None:
    theirs, ours, heard = own_channel(MULTICAST), own_channel(MULTICAST), SimpleQueue[int]()
    begin = GeneralPurposeUdpMulticastBus.__init__
    with plain_bus(theirs) as other, plain_bus(ours) as own:

        def meanwhile(bus: GeneralPurposeUdpMulticastBus, *arguments: object) -> None:
            begin(bus, *arguments)  # its socket is bound from here on, and set up later
            other.send(_frame(0x000, "81 00"))  # resets all nodes
            send_rubbish(theirs)

        monkeypatch.setattr(GeneralPurposeUdpMulticastBus, "__init__", meanwhile)
        link = CanLink(links.CanBus(interface=MULTICAST, channel=ours))
        link.tap(lambda _sent, frame: heard.put(frame.arbitration_id))
        link.open()
        own.send(_frame(0x123, ""))
        first = heard.get(timeout=10)
        link.close()
    assert first == 0x123


class _Answers:
    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.heard: list[can.Message] = []

    def until(self, cob_id: int) -> can.Message:
        while True:
            try:
                message = self._bus.recv(10)
            except can.CanOperationError:  # no frame
                continue
            assert message is not None
            self.heard.append(message)
            if message.arbitration_id == cob_id:
                return message

    def ask(self, cob_id: int, data: str, answer: int) -> str:
        self._bus.send(_frame(cob_id, data))
        return bytes(self.until(answer).data).hex()


def _frame(cob_id: int, data: str) -> can.Message:
    return can.Message(arbitration_id=cob_id, is_extended_id=False, data=bytes.fromhex(data))
