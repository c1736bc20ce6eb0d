"""A CAN link: which frames it hands to whom, and what each failure of bus and nodes is told as."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import can
import canopen
import numpy as np
import pytest
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from palpate.drivers.bench import Bench
from palpate.drivers.links.can import LATE_ANSWERS, CanLink
from palpate.instrument.bench import links
from palpate.instrument.bench.links import MULTICAST, Block, time_of
from palpate.instrument.errors import ConfigError, DeviceError, LinkError, LinkTimeout
from palpate.procedures.testing.wire import impatient_node
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.wire.can_bus import own_channel


class Bus(can.BusABC):
    """A bus without a wire, which keeps what is sent."""

    def __init__(self, **settings: object) -> None:
        self.settings = settings
        self.sent: list[can.Message] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.sent.append(msg)

    def fileno(self) -> int:
        return 77

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return None, True


def frame(identifier: int, data: bytes = b"", **flags: Any) -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, **{"is_extended_id": False, **flags})


def heard_of(link: CanLink, message: can.Message) -> None:
    for listener in link.network.listeners:
        listener(message)


# --- what is heard -------------------------------------------------------------------------------------


@pytest.mark.parametrize("flag", ["is_extended_id", "is_fd", "is_remote_frame", "is_error_frame"])
def test_a_frame_of_another_kind_goes_to_nobody(flag: str, link: CanLink) -> None:
    """canopen would take an extended identifier for the standard one."""
    heard: list[tuple[object, ...]] = []
    link.open()
    link.subscribe(0x181, lambda *told: heard.append(told))
    heard_of(link, frame(0x181, **{flag: True}))
    counted = [link.error_frames() for _ in range(2)]  # since it was last asked for
    assert (heard, counted) == ([], [flag == "is_error_frame", 0])


def test_a_malformed_frame_does_not_end_the_thread_that_hears_frames(
    link: CanLink, caplog: pytest.LogCaptureFixture
) -> None:
    def refuses(*_: object) -> None:
        raise IndexError("too short")

    link.open()
    link.subscribe(0x181, refuses)
    with caplog.at_level(logging.ERROR, "canopen"):
        heard_of(link, frame(0x181))
    assert [record.getMessage() for record in caplog.records] == ["too short"]


# --- what a tap is told of -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("came", "others"),
    [
        ([0x601, 0x581, 0x601, 0x602, 0x603], [0x581, 0x601]),  # the second is somebody else's: ours has come back
        ([0x602, 0x601, 0x603], [0x601]),  # the echo of 0x601 was lost, so the one that comes is another's
    ],
)
def test_a_frame_is_told_of_once_though_the_bus_brings_it_back_and_a_lost_echo_hides_nothing(
    came: list[int], others: list[int], link: CanLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("palpate.drivers.links.can.keep_to_group", lambda _bus: None)
    link = CanLink(links.CanBus.model_validate({**DESCRIBED, "interface": MULTICAST}))
    told = list[tuple[bool, int]]()

    def heard(sent: bool, message: can.Message) -> None:
        assert message not in bus.sent, "told before it is sent"
        told.append((sent, message.arbitration_id))

    link.tap(heard)
    link.open()
    bus: Any = link.network.bus
    for identifier in (0x601, 0x602, 0x603):
        bus.send(frame(identifier))
    for identifier in came:
        heard_of(link, frame(identifier))
    assert told == [(True, 0x601), (True, 0x602), (True, 0x603), *((False, each) for each in others)]


# --- opening -------------------------------------------------------------------------------------------


@pytest.fixture
def link(monkeypatch: pytest.MonkeyPatch) -> Iterator[CanLink]:
    """A link that is not open yet."""
    monkeypatch.setattr(can, "Bus", Bus)
    monkeypatch.setattr(canopen.Network, "connect", lambda _network: None)
    monkeypatch.setattr(canopen.Network, "disconnect", lambda _network: None)
    yield CanLink(links.CanBus.model_validate(DESCRIBED))


DESCRIBED = {"interface": "pcan", "channel": "USB1", "bitrate": 125_000, "timeout": "250 ms"}


def test_a_bus_is_opened_as_the_bench_file_says(link: CanLink) -> None:
    link.open()
    bus: Any = link.network.bus
    assert bus.settings == {"interface": "pcan", "channel": "USB1", "bitrate": 125_000}
    assert link.name == "pcan:USB1"


def test_an_interface_that_python_can_does_not_have_is_refused_before_anything_is_opened() -> None:
    with pytest.raises(ConfigError, match=r"unknown interface 'pcann' \(did you mean 'pcan'\?\); valid: .*socketcan"):
        CanLink(links.CanBus.model_validate({**DESCRIBED, "interface": "pcann"}))


@pytest.mark.parametrize(("interface", "kept", "heard"), [(MULTICAST, 1, 1), ("pcan", 0, 2)])
def test_a_multicast_bus_keeps_to_its_group_and_echoes(
    interface: str, kept: int, heard: int, link: CanLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    groups, told = list[object](), list[bool]()
    monkeypatch.setattr("palpate.drivers.links.can.keep_to_group", groups.append)
    link = CanLink(links.CanBus.model_validate({**DESCRIBED, "interface": interface}))
    link.tap(lambda sent, _message: told.append(sent))
    link.open()
    bus: Any = link.network.bus
    bus.send(frame(0x601))
    for listener in link.network.listeners:
        listener(frame(0x601))
    assert (groups, told) == (kept * [bus], [True, False][:heard])


def block() -> Block:
    """Two SYNCs, with a frame of node 1 and one of node 2 at each."""
    one, two = (np.array([[number, 0], [number, 1]], np.uint8) for number in (1, 2))
    return Block(np.array([1000, 2000]), [(0x80, np.empty((2, 0), np.uint8)), (0x181, one), (0x182, two)])


def test_a_block_goes_whole_to_those_who_take_blocks_and_frame_by_frame_to_others(link: CanLink) -> None:
    link.open()
    whole, single = list[object](), list[tuple[object, ...]]()
    taken: Callable[..., None] = lambda *told: single.append(("of a block", *told))  # noqa: E731
    for identifier in (0x181, 0x182):
        link.subscribe(identifier, taken)
    link.take_blocks(taken, lambda columns: whole.append({at: data.tolist() for at, data in columns.items()}))
    for identifier in (0x182, 0x80):
        link.subscribe(identifier, lambda *told: single.append(told))
    (arrive,) = link.network.listeners
    arrive(block())  # type: ignore[arg-type]
    assert whole == [{0x181: [[1, 0], [1, 1]], 0x182: [[2, 0], [2, 1]]}]
    assert single == [(0x80, b"", 1e-6), (0x182, b"\2\0", 1e-6), (0x80, b"", 2e-6), (0x182, b"\2\1", 2e-6)]
    assert arrive.nodes  # type: ignore[attr-defined]  # why a node is silent: others are heard
    arrive(frame(0x181, b"alone"))
    assert single[-1][:3] == ("of a block", 0x181, b"alone")


def test_a_tap_hears_each_frame_of_a_block_with_its_own_time(link: CanLink) -> None:
    told: list[can.Message] = []
    link.tap(lambda _sent, message: told.append(message))
    link.open()
    for listener in link.network.listeners:
        listener(block())  # type: ignore[arg-type]
    assert [(m.arbitration_id, bytes(m.data)) for m in told[:3]] == [(0x80, b""), (0x181, b"\1\0"), (0x182, b"\2\0")]
    assert [time_of(m) for m in told] == [1000, 1000, 1000, 2000, 2000, 2000]


def test_nothing_is_kept_for_ever_of_what_nobody_asks_for(link: CanLink) -> None:
    """canopen keeps answers of layer setting services, and emergencies of a node."""
    link.open()
    assert not link.network.subscribers.get(0x7E4)
    node: Any = link.add_node(1)
    heard_of(link, frame(0x81, bytes(8)))
    assert (node.emcy.log, node.emcy.active) == ([], [])


def test_a_closed_link_is_not_open(link: CanLink, monkeypatch: pytest.MonkeyPatch) -> None:
    gone: list[str] = []
    link.open()
    monkeypatch.setattr(canopen.Network, "disconnect", lambda _network: gone.append("disconnected"))
    link.close()
    link.close()
    assert gone == ["disconnected"]
    with pytest.raises(LinkError, match=r"^CAN bus pcan:USB1 is not open; open the bench first$"):
        link.subscribe(0x181, lambda *_: None)


@pytest.mark.parametrize("interface", ["virtual", MULTICAST])
def test_closing_a_bus_within_this_machine_wakes_the_thread_that_listens(
    interface: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(canopen.Network, "NOTIFIER_CYCLE", 300.0)  # without being woken it would listen for so long
    heard: list[tuple[bool, can.Message]] = []
    link = CanLink(links.CanBus(interface=interface, channel=own_channel(interface)))
    link.tap(lambda sent, message: heard.append((sent, message)))
    before = set(threading.enumerate())
    link.open()
    listening = set(threading.enumerate()) - before
    link.close()
    assert len(listening) == 1
    assert not any(thread.is_alive() for thread in listening)
    assert heard == []


# --- transfers -----------------------------------------------------------------------------------------


def fails(error: Exception) -> Callable[..., Any]:
    def call(*_: object) -> Any:
        raise error

    return call


@pytest.fixture
def node(link: CanLink) -> Any:
    link.open()
    return link.add_node(1)


@pytest.mark.parametrize(
    ("error", "kind", "message", "due"),
    [
        (SdoAbortedError(0x0602_0000), DeviceError, "aborted the transfer: Code 0x06020000, Object does not", False),
        (
            SdoCommunicationError("none"),
            LinkTimeout,
            r"no valid answer within 0\.25 s; nothing is heard on pcan:USB1; check power",
            True,
        ),
        (can.CanOperationError("off"), LinkError, "CAN bus pcan:USB1 failed: off; check adapter and termination", True),
        (OSError("off"), LinkError, "CAN bus pcan:USB1 failed: off; check adapter and termination", True),
    ],
)
def test_each_failure_of_a_transfer_names_the_node_and_an_answer_may_still_be_due(
    error: Exception, kind: type[Exception], message: str, due: bool, link: CanLink, node: Any
) -> None:
    node.sdo.upload = fails(error)
    with pytest.raises(kind, match=f"^node 1: {message}") as caught:
        link.upload("node 1", node, 0x2000, 0)
    assert type(caught.value) is kind
    listened = list[float]()

    def silent(timeout: float) -> None:
        listened.append(timeout)
        raise queue.Empty

    node.sdo.responses.get = silent
    node.sdo.upload = lambda *asked: repr(asked)
    for _ in range(2):
        assert link.upload("node 1", node, 0x2000, 1, 4) == "(8192, 1, 4)"  # type: ignore[comparison-overlap]
    assert listened == ([0.25] if due else [])


def test_where_all_answers_came_too_soon_the_message_says_so(link: CanLink, node: Any) -> None:
    node.sdo.upload, node.sdo.too_soon = fails(SdoCommunicationError("none")), 2
    with pytest.raises(LinkTimeout, match=r"; 2 answers came sooner than 125000 bit/s can .*its true bitrate$"):
        link.upload("node 1", node, 0x2000, 0)


@pytest.mark.parametrize(("late", "refused"), [(LATE_ANSWERS - 1, False), (LATE_ANSWERS, True)])
def test_a_node_may_give_as_many_late_answers_as_a_transfer_can_leave(late: int, refused: bool, link: CanLink) -> None:
    link = CanLink(links.CanBus.model_validate(DESCRIBED).model_copy(update={"timeout": 1e-9}))
    link.open()
    node: Any = link.add_node(1)
    node.sdo.upload = fails(SdoCommunicationError("none"))
    with pytest.raises(LinkTimeout):
        link.upload("node 1", node, 0x2000, 0)
    node.sdo.upload = lambda *_: b"ok"
    for _ in range(late):
        node.sdo.responses.put(bytes(8))
    if refused:
        with pytest.raises(LinkError, match=r"^node 1: keeps sending unasked answers; look for a second SDO client"):
            link.upload("node 1", node, 0x2000, 0)
    else:
        assert link.upload("node 1", node, 0x2000, 0) == b"ok"


@pytest.mark.parametrize("error", [can.CanOperationError("off"), OSError("off")])
def test_a_command_goes_to_the_node_or_its_failure_is_told(error: Exception, link: CanLink, node: Any) -> None:
    link.command(node, "STOPPED")
    bus: Any = link.network.bus
    assert [(sent.arbitration_id, bytes(sent.data)) for sent in bus.sent] == [(0, b"\x02\x01")]  # CiA 301: 2 is stop
    bus.send = fails(error)
    with pytest.raises(LinkError, match=r"^CAN bus pcan:USB1 failed: off; check adapter and termination$"):
        link.command(node, "OPERATIONAL")


def test_a_heartbeat_goes_out_while_a_transfer_waits_for_its_answer(link: CanLink, node: Any) -> None:
    def waits(_index: int, _subindex: int, _size: int) -> bytes:
        beating = threading.Thread(target=link.beat, args=(127,), daemon=True)
        beating.start()
        beating.join(5.0)
        return bytes([beating.is_alive()])

    node.sdo.upload = waits
    assert link.upload("node", node, 0x1000, 0, 1) == b"\0"
    assert [(each.arbitration_id, bytes(each.data)) for each in link.network.bus.sent] == [(0x77F, b"\5")]  # type: ignore[union-attr]


# --- on a simulated bus --------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_adapter_that_was_pulled_out_is_a_link_error_in_use_and_in_closing(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unplugged(*_: object, **__: object) -> None:
        raise can.CanOperationError("adapter unplugged")

    link, before = CanLink(sim.description.links["can"]), set(threading.enumerate())
    link.open()
    node = link.add_node(1)
    monkeypatch.setattr(link.network.bus, "recv", unplugged)
    for listening in set(threading.enumerate()) - before:
        listening.join()
    with pytest.raises(LinkError, match=r"^node: CAN bus virtual:.* failed: adapter unplugged"):
        link.upload("node", node, 0x1000, 0)
    with pytest.raises(LinkError, match=r"virtual:.* failed: adapter unplugged"):
        link.close()
    link.close()


def test_a_transfer_that_a_signal_breaks_off_leaves_its_answer_to_nobody(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = bench.device("sensor_node_1")
    sdo: Any = node.link.network[1].sdo

    looks = iter([0.0])  # before the request is sent

    def interrupted() -> float:
        for now in looks:
            return now
        raise KeyboardInterrupt

    with sim.clock.lock, impatient_node(node, monkeypatch), monkeypatch.context() as patch:
        patch.setattr(sdo, "now", interrupted)  # which is looked at again when the request is sent
        with pytest.raises(KeyboardInterrupt):
            node.set("sync_period", 0.5)
    assert node.get("sync_period") == 0.5


def test_threads_take_turns_on_a_bus(bench: Bench) -> None:
    node = bench.device("sensor_node_1")
    wanted = ["probe", "heartbeat", "vendor", "sync_period"]
    with ThreadPoolExecutor(len(wanted)) as pool:
        answers = list(pool.map(lambda name: {node.get(name) for _ in range(50)}, wanted))
    assert answers == [{0x12345678}, {1.0}, {0x50414C50}, {0.001}]
