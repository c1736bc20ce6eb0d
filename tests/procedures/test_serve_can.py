"""The CAN bus of a served bench on UDP multicast, for a plain master of another process."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from queue import SimpleQueue

import can
import pytest
from can.interfaces.udp_multicast.bus import GeneralPurposeUdpMulticastBus

from palpate.drivers.links.can import CanLink
from palpate.instrument.bench import links
from palpate.instrument.bench.links import MULTICAST, keep_to_group
from palpate.instrument.contracts.field import PROBE
from palpate.procedures.virtual.served_bench import Wish, serving
from palpate.simulators.bench import BenchAddresses
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.can_bus import own_channel

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
