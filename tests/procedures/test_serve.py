"""`palpate serve`: the bench of one process, for the clients of another."""

from __future__ import annotations

import errno
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
from typing import Any

import pytest
from rich.console import Console

from palpate.drivers.bench import Bench
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.description import read_bench
from palpate.instrument.calibration.load_cell import STANDARD_GRAVITY
from palpate.instrument.contracts.own import SHAKER_AMPLIFIER as AMPLIFIER
from palpate.instrument.errors import DeviceError
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.console.terminal import Progress
from palpate.procedures.lab import open as session
from palpate.procedures.records.run import Run
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
from palpate.simulators.scenes.heads import shipped
from palpate.simulators.scenes.scene import Scene
from tests.procedures.conftest import Palpate, happens_in

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


def same_wall(monkeypatch: pytest.MonkeyPatch, sim: SimulatedBench) -> None:
    """The client's wall clock is the bench's, so that nobody waits."""
    monkeypatch.setattr(session, "WallClock", lambda _begun: sim.clock)


@pytest.mark.slow
def test_a_sweep_that_is_interrupted_finds_each_sample_by_its_name_when_it_is_run_again_or_resumed(
    palpate: Palpate,
    wish: Wish,
    monkeypatch: pytest.MonkeyPatch,
    on_progress: Callable[[Progress], None],
) -> None:
    """The bench is served with a sample changer; a bench of its own, with other noise, says what is to be found."""
    sweep = ("sweep", "loads", "--samples", "1,2", "--loads", "2 N", "--dwell", "0.2 s", "--json")
    alone = palpate(*sweep, "--seed", "5").object["samples"]
    place = Path("bench.toml")
    moments = [KeyboardInterrupt]

    def interrupt(_done: int, _total: int, what: str) -> None:
        if what.startswith("sample 2") and moments:
            raise moments.pop()

    on_progress(interrupt)
    monkeypatch.setattr(sys, "stdin", None)
    with serving(replace(wish, samples=tuple(map(get_sample, "123")), out=place)) as served:
        same_wall(monkeypatch, served.sim)
        assert palpate(*sweep, "--bench", str(place), "--out", "cut").status == 130
        again = palpate(*sweep, "--bench", str(place)).object
        resumed = palpate("runs", "resume", "cut", "--json").object
    for found in (again, resumed):
        assert found["simulated"]
        for one, other in zip(found["samples"], alone, strict=True):
            apart = 3 * math.hypot(one["force_ratio_u"], other["force_ratio_u"])
            assert one["force_ratio"] == pytest.approx(other["force_ratio"], abs=apart)


@pytest.mark.parametrize("text", ['name = "my bench"\n', "", "\xff"])
def test_a_bench_file_that_a_person_wrote_is_not_overwritten(text: str, palpate: Palpate) -> None:
    Path("my_bench.toml").write_text(text, encoding="latin-1")
    refused = palpate("serve", "ideal", "--can", "virtual", "--out", "my_bench.toml")
    assert (refused.status, Path("my_bench.toml").read_text(encoding="latin-1")) == (2, text)
    assert refused.complaint == "my_bench.toml exists, and palpate serve did not write it; choose another --out"


def test_a_file_that_cannot_be_looked_at_is_no_traceback(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    def sealed(_path: Path) -> bytes:
        raise PermissionError(errno.EACCES, "Permission denied")

    Path("sealed.toml").touch()
    monkeypatch.setattr(Path, "read_bytes", sealed)
    refused = palpate("serve", "ideal", "--can", "virtual", "--out", "sealed.toml")
    assert (refused.status, "sealed.toml: Permission denied" in refused.complaint) == (1, True)


def test_the_bench_file_of_a_run_is_not_overwritten_and_that_of_an_earlier_served_bench_is(
    palpate: Palpate, wish: Wish
) -> None:
    earlier = Path("bench.toml")
    with serving(replace(wish, out=earlier)):
        first = earlier.read_text(encoding="utf-8")
    with serving(replace(wish, out=earlier)) as again:
        assert earlier.read_text(encoding="utf-8") == again.description.to_toml()
    Path("run").mkdir()
    Path("run/run.record").touch()
    Path("run/bench.toml").write_text(first, encoding="utf-8")
    refused = palpate("serve", "ideal", "--can", "virtual", "--out", "run/bench.toml")
    assert (refused.status, Path("run/bench.toml").read_text(encoding="utf-8")) == (2, first)
    assert refused.complaint == "run/bench.toml belongs to a run; choose another --out"


def test_a_bench_whose_amplifier_anybody_feeds_says_so_before_it_drives_and_in_its_record(
    palpate: Palpate, wish: Wish, monkeypatch: pytest.MonkeyPatch, on_progress: Callable[[Progress], None]
) -> None:
    place = Path("bench.toml")

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    on_progress(interrupt)
    with serving(replace(wish, samples=(get_sample("1"),), out=place)) as served:
        same_wall(monkeypatch, served.sim)
        place.write_text(place.read_text().replace('watchdog_fed_by = "owner"', 'watchdog_fed_by = "any request"'))
        said = palpate("sweep", "loads", "--samples", "1", "--bench", str(place), "--out", "run")
        assert said.status == 130
        assert re.match("palpate: note: shaker amplifier at .*: any request feeds its watchdog", said.err)
        assert Run.open(Path("run")).events()[0]["kind"] == "caution"


@pytest.mark.slow
def test_a_log_of_a_bench_with_a_sample_changer_is_shown_and_replayed(
    palpate: Palpate, wish: Wish, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep = ("sweep", "loads", "--samples", "2", "--loads", "2 N", "--dwell", "0.2 s", "--bench", "b.toml")
    monkeypatch.setattr(sys, "stdin", None)
    with serving(replace(wish, samples=(get_sample("1"), get_sample("2")), out=Path("b.toml"))) as served:
        same_wall(monkeypatch, served.sim)
        found = palpate(*sweep, "--log", "trace.blf", "--json").object
    shown = palpate("bus", "show", "trace.pcapng").out
    assert "sample_changer <- write order = '2'" in " ".join(shown.split())
    assert "mounted = '2'" in shown
    again = palpate("bus", "replay", "trace.pcapng", "--json").object
    assert (again["points"], again["mounting"]) == (found["points"], "sample changer")


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
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch, line: str, seen: Callable[[SimulatedBench], bool]
) -> None:
    was = []
    monkeypatch.setattr(SimulatedBench, "__exit__", _look_first(was, seen))
    with typing(f"{line}\nquit\n", monkeypatch):
        said = palpate("serve", "thesis_single", "--can", "virtual", "--quiet")
    assert (said.status, said.out, said.err) == (0, "", f"done: {line}\n")
    assert was == [True]


def _look_first(was: list[bool], seen: Callable[[SimulatedBench], bool]) -> Any:
    leave = SimulatedBench.__exit__

    def exit_(sim: SimulatedBench, *error: object) -> None:
        was.append(bool(seen(sim)))
        leave(sim, *error)

    return exit_


@pytest.mark.parametrize(
    "line",
    [
        *("mount", "mount 9", "weight heavy", "weight -5 g", "probe 1 mm", "tooth 2", "tooth 1.5", "turn 1e9"),
        *("warm 1e9 K", "dance", "mount '1", "fault line", "clear all"),
    ],
)
def test_a_mistyped_line_is_said_and_stops_nothing(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    with typing(f"{line}\nturn 90\nquit\n", monkeypatch):
        said = palpate("serve", "thesis_single", "--can", "virtual", "--quiet")
    first, second = said.err.splitlines()
    assert first.startswith("palpate: ")
    assert (said.status, second) == (0, "done: turn 90")


@pytest.mark.parametrize(("handler", "goes_on"), [(signal.SIG_IGN, True), (signal.SIG_DFL, False)])
def test_a_hang_up_ends_a_served_bench_but_not_one_that_was_started_to_ignore_it(
    handler: signal.Handlers, goes_on: bool, palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Person, "do", lambda _person, _line: os.kill(os.getpid(), signal.SIGHUP))
    before = signal.signal(signal.SIGHUP, handler)
    try:
        with typing("hang up\nquit\n", monkeypatch):
            said = palpate("serve", "thesis_single", "--can", "virtual", "--quiet")
        assert signal.getsignal(signal.SIGHUP) == handler
    finally:
        signal.signal(signal.SIGHUP, before)
    assert (said.status, said.err) == (0, "done: hang up\n" if goes_on else "")


def test_an_interrupt_ends_a_served_bench_also_where_a_script_has_started_it_to_ignore_them(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Person, "do", lambda _person, _line: os.kill(os.getpid(), signal.SIGINT))
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with typing("interrupt\nquit\n", monkeypatch):
            said = palpate("serve", "thesis_single", "--can", "virtual", "--quiet")
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
    assert (said.status, said.err) == (0, "")


def test_json_says_where_everything_is(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    with typing("quit\n", monkeypatch):
        found = palpate(
            "serve",
            "thesis_single",
            "--seed",
            "3",
            "--can",
            "virtual:mine",
            "--line",
            "line",
            "--out",
            "b.toml",
            "--json",
        ).object
    assert (found["scene"], found["seed"], found["speed"], found["bench_file"]) == ("thesis_single", 3, 1.0, "b.toml")
    assert found["bench"] == read_bench(Path("b.toml")).model_dump(mode="json")
    assert found["bench"]["link"]["can"]["channel"] == "mine"
    assert found["bench"]["link"]["line"]["port"] == str(Path("line").absolute())
    assert not Path("line").is_symlink()


def test_the_watchdog_of_a_fast_bench_counts_the_time_of_its_clients(wish: Wish) -> None:
    with serving(replace(wish, speed=10.0)) as served:
        sim = served.sim
        sim.amplifier.write({"watchdog": 2.0, "enable": 1.0})
        sim.amplifier.requested()
        sim.clock.wait(19.9)
        assert sim.amplifier.settings["enable"]
        sim.clock.wait(0.2)
        assert not sim.amplifier.settings["enable"]


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
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = Path("mine.toml")
    file.write_text((shipped()["thesis_single"]).read_text())
    was: list[bool] = []

    def spoilt(sim: SimulatedBench) -> bool:
        file.write_text("rubbish")
        sim.clock.wait(1.0)
        with Bench(sim.description, sim.clock, sim.operator) as bench:
            return bench.simulated

    monkeypatch.setattr(SimulatedBench, "__exit__", _look_first(was, spoilt))
    with typing("quit\n", monkeypatch):
        said = palpate("serve", "mine.toml", "--can", "virtual", "--quiet")
    assert (said.status, said.err, was) == (0, "", [True])
    with typing("quit\n", monkeypatch):
        assert "mine.toml" in palpate("serve", "mine.toml", "--can", "virtual").complaint


# --- time ----------------------------------------------------------------------------------------------


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


def test_a_scene_that_fails_ends_the_serving_with_its_reason(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_clock: VirtualClock, _duration: float) -> None:
        raise ArithmeticError("the chain flies apart")

    monkeypatch.setattr(VirtualClock, "wait", fail)
    with typing("", monkeypatch):
        said = palpate("serve", "thesis_single", "--can", "virtual", "--quiet")
    assert said.status == 1
    assert said.complaint.startswith("the simulation has failed: the chain flies apart; serve the bench again")


def test_the_page_shows_outputs_readings_faults_and_traffic(wish: Wish) -> None:
    with (
        serving(wish) as served,
        socket.create_connection(
            (served.description.links["signal_generator"].host, served.description.links["signal_generator"].port)
        ) as client,
    ):
        sim = served.sim
        sim.generator.write({"amplitude": 0.5, "frequency": 20.0, "output": 1.0})
        sim.amplifier.trip("watchdog")
        traffic = TransactionRate(sim)
        traffic.rate(1.0)
        for _ in range(6):
            client.sendall(bytes.fromhex("0001 0000 0006 01 03 7000 0001"))
            assert client.recv(100)
        console = Console(width=100, record=True, file=StringIO())
        console.print(status(sim, state_of(sim, traffic.rate(3.0), 0.0)))
    page = " ".join(console.export_text().split())
    for shown in (
        "SIMULATED",
        "on, 500 mV at 20 Hz",
        "latched watchdog",
        "1 pre-operational",
        "of 1 Mbit/s at worst",
        "3 transactions/s",
        "mV",
    ):
        assert shown in page, page


# --- what cannot be served -----------------------------------------------------------------------------


def test_a_port_in_use_is_named(palpate: Palpate) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        said = palpate("serve", "thesis_single", "--can", "virtual", "--port", str(port))
    assert said.status == 1
    assert said.complaint == (
        f"cannot listen on 127.0.0.1:{port}: the port is in use, "
        "or the host is no address of this machine; give another"
    )


@pytest.mark.parametrize(
    ("options", "status", "names"),
    [
        (("--can", "nonsense:0"), 1, "nonsense:0"),
        (("--can", "kvaser:0"), 1, "kvaser:0"),
        (("--can", "udp_multicast:10.0.0.1"), 1, "udp_multicast:10.0.0.1"),
        (("--can", "virtual", "--listen", "192.0.2.1"), 1, "192.0.2.1"),
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
    said = palpate("serve", "thesis_single", *options)
    assert said.status == status
    assert names in said.complaint
