"""A served bench: faults that are typed, and its CAN bus for plain masters."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any

import can
import pytest
from can.interfaces.udp_multicast.bus import GeneralPurposeUdpMulticastBus

from palpate.drivers.links.can import CanLink
from palpate.extend import Bench, Scene
from palpate.instrument.bench import links
from palpate.instrument.bench.links import MULTICAST, keep_to_group
from palpate.instrument.contracts.field import PROBE
from palpate.instrument.errors import BenchError, ConfigError, LinkError, PalpateError, UsageError
from palpate.procedures.virtual.served_bench import Person, Wish, serving
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.fault import places, struck
from palpate.simulators.planning.settle import with_faults
from palpate.simulators.wire.can_bus import own_channel
from tests.conftest import hasty


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
    assert person.do("faults") == "no fault is given"
    assert look(bench) == before


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
def wish(scene: Scene, nothing_left_behind: None) -> Wish:
    return Wish(scene, BenchAddresses(interface=MULTICAST), None, 1.0, 1.0, (), None)


@contextmanager
def plain_bus(channel: str) -> Iterator[can.BusABC]:
    with can.Bus(interface=MULTICAST, channel=channel, hop_limit=0) as bus:
        keep_to_group(bus)
        yield bus


def test_a_plain_can_master_on_multicast_sees_each_sync_sampled_once(wish: Wish) -> None:
    """The server's own SYNC comes back to it there, and is none of the master's."""
    with serving(wish) as served:
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


def test_rubbish_on_multicast_ends_neither_the_bench_nor_its_client_nor_a_plain_master(wish: Wish) -> None:
    with serving(wish) as served:
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
