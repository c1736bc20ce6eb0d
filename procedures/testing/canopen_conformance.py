"""Tests that every CANopen device kind must pass, with its driver and its simulator."""

from __future__ import annotations

import queue
import re
import threading
from collections.abc import Iterator
from typing import Any

import can
import pytest
from canopen.sdo.exceptions import SdoAbortedError

from palpate.drivers.bench import Bench
from palpate.drivers.devices.canopen_device import CanopenDevice
from palpate.instrument.contracts.field import Field
from palpate.instrument.errors import DeviceError, IdentityError, LinkTimeout, RangeError
from palpate.procedures.testing.conformance import (
    Conformance,
    first,
    inside,
    number,
    outside,
    outside_raw,
    settings,
    writable,
)
from palpate.procedures.testing.wire import frames, impatient_node, transfers
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.wire.canopen_device import SimulatedNode

READ_ONLY, NO_OBJECT, NO_SUBINDEX = 0x0601_0002, 0x0602_0000, 0x0609_0011
WRONG_LENGTH, NO_CHOICE, TOO_HIGH, TOO_LOW = 0x0607_0010, 0x0609_0030, 0x0609_0031, 0x0609_0032
GENERAL_ERROR = 0x0800_0000
SWAPPED_PROBE = 0x78563412


class CanopenConformance(Conformance):
    """Tests of a driver and its simulated node, over a CAN bus."""

    @pytest.fixture(scope="class")
    @classmethod
    def listener(cls, sim: SimulatedBench) -> Iterator[can.BusABC]:
        """A listener that joins the bus before the drivers, so that it has each answer before a driver has it."""
        with can.Bus(interface="virtual", channel=sim.channel) as bus:
            yield bus

    @pytest.fixture
    def node(self, listener: can.BusABC, bench: Bench, sim: SimulatedBench) -> CanopenDevice:
        node: CanopenDevice = self.ends(bench, sim)[0]
        frames(listener)
        return node

    @staticmethod
    def abort_code(node: CanopenDevice, field: Field, data: bytes) -> int:
        """Write an object like any CANopen client, without the driver's checks; returns the abort code, 0 for none."""
        try:
            node._node.sdo.download(field.index, field.subindex, data)
        except SdoAbortedError as abort:
            code: int = abort.code
            return code
        return 0

    def test_its_identity_is_checked_and_its_serial_number_read(
        self, node: CanopenDevice, simulated: SimulatedNode
    ) -> None:
        node.serial = ""
        node.connect()
        assert node.serial == f"{int(simulated.settings['serial']):08X}"

    @pytest.mark.parametrize("name", ["vendor", "product", "revision"])
    def test_another_identity_is_refused(
        self, name: str, node: CanopenDevice, simulated: SimulatedNode, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(simulated.settings, name, simulated.settings[name] + 0x1_0000)
        found = f"{node.name}: .*0x{int(simulated.settings[name]):08X}.*the contract is for .*check the node id"
        with pytest.raises(IdentityError, match=found):
            node.connect()

    def test_a_later_minor_revision_is_accepted(
        self, node: CanopenDevice, simulated: SimulatedNode, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(simulated.settings, "revision", simulated.settings["revision"] + 7)
        node.connect()

    def test_another_byte_order_is_refused_with_the_remedy(
        self, node: CanopenDevice, simulated: SimulatedNode, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(simulated.settings, "probe", float(SWAPPED_PROBE))
        with pytest.raises(IdentityError, match=r"0x78563412.*little-endian.*firmware"):
            node.connect()

    def test_every_setting_reads_back_as_it_was_written(self, node: CanopenDevice) -> None:
        for field in settings(node.contract):
            before = node.get(field.name)
            for value in [*inside(field), before]:
                node.set(field.name, value)
                assert node.get(field.name) == number(field, value), field.name

    def test_a_value_out_of_range_is_refused_before_anything_is_sent(
        self, node: CanopenDevice, listener: can.BusABC
    ) -> None:
        for field in writable(node.contract):
            for value in outside(field):
                with pytest.raises(RangeError, match=f"{node.contract.title}: {field.name} = "):
                    node.set(field.name, value)
        assert frames(listener) == []

    def test_the_node_itself_refuses_a_value_out_of_range(
        self, node: CanopenDevice, simulated: SimulatedNode, listener: can.BusABC
    ) -> None:
        for field in writable(node.contract):
            before = dict(simulated.settings)
            for raw, too_high in outside_raw(field):
                code = NO_CHOICE if field.choices else TOO_HIGH if too_high else TOO_LOW
                assert self.abort_code(node, field, raw.to_bytes(field.size, "little", signed=raw < 0)) == code, (
                    field.name,
                    raw,
                )
                assert simulated.settings == before

    def test_the_node_refuses_a_write_to_what_is_read_only(self, node: CanopenDevice) -> None:
        for field in node.contract.fields:
            if field.access == "ro":
                size = 4 if field.type == "text" else field.size
                assert self.abort_code(node, field, bytes(size)) == READ_ONLY, field.name

    def test_the_node_refuses_half_of_a_value(self, node: CanopenDevice, simulated: SimulatedNode) -> None:
        before = dict(simulated.settings)
        for field in writable(node.contract):
            for size in {1, 2, 4} - {field.size}:
                assert self.abort_code(node, field, bytes(size)) == WRONG_LENGTH, (field.name, size)
        assert simulated.settings == before

    def test_the_node_refuses_an_unknown_object(self, node: CanopenDevice) -> None:
        addresses = {f.address for f in node.contract.fields}
        group = next(f for f in node.contract.fields if f.subindex)
        sdo: Any = node._node.sdo
        for index, subindex, code in ((0x5FFF, 0, NO_OBJECT), (group.index, 0x7F, NO_SUBINDEX)):
            assert index << 8 | subindex not in addresses
            for access, data in ((sdo.upload, ()), (sdo.download, (bytes(4),))):
                with pytest.raises(SdoAbortedError) as abort:
                    access(index, subindex, *data)
                assert abort.value.code == code

    def test_a_refusal_names_node_field_value_and_limit(
        self, node: CanopenDevice, simulated: SimulatedNode, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def refuse(*_: Any) -> None:
            raise SdoAbortedError(GENERAL_ERROR)

        monkeypatch.setattr(simulated, "write", refuse)
        for field in writable(node.contract):
            value = inside(field)[0]
            limits = ", ".join(field.choices) if field.choices else f"{field.minimum:g} to {field.maximum:g}"
            with pytest.raises(DeviceError) as failure:
                node.set(field.name, value)
            message = str(failure.value)
            assert message.startswith(f"{node.name}: aborted the transfer: Code 0x08000000, General error")
            assert re.search(rf"{field.name} = {value}.*\({re.escape(limits)}\)", message), message

    def test_a_refused_read_names_node_and_field(self, node: CanopenDevice, simulated: SimulatedNode) -> None:
        field = first([f for f in node.contract.fields if f.access == "wo"], "order")
        with pytest.raises(DeviceError, match=f"^{re.escape(node.name)}: aborted the transfer: .*{field.name}"):
            node.get(field.name)

    def test_a_write_that_gets_no_answer_is_not_repeated(
        self, node: CanopenDevice, sim: SimulatedBench, listener: can.BusABC, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        field = first(settings(node.contract), "setting")
        silence = f"^{re.escape(node.name)}: no valid answer within 0.2 s"
        stalled = sim.clock.lock
        with stalled, impatient_node(node, monkeypatch), pytest.raises(LinkTimeout, match=silence):
            node.set(field.name, inside(field)[1])
        node.get("probe")
        requests, _ = transfers(listener, node.id)
        address = field.index.to_bytes(2, "little") + bytes([field.subindex])
        assert [request[1:4] for request in requests].count(address) == 1

    def test_a_late_answer_never_answers_the_next_request(
        self, node: CanopenDevice, simulated: SimulatedNode, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The answer to a read of an object comes only when the same object, changed meanwhile, is read again."""
        field = first([f for f in settings(node.contract) if not f.choices], "setting that is a number")
        old, new = node.get(field.name), inside(field)[-1]
        sdo: Any = node._node.sdo
        late: list[bytes] = []
        swallowed = threading.Event()

        class Delayed(queue.Queue[bytes]):
            """Holds the first answer back until the next read."""

            def put(self, item: bytes, block: bool = True, timeout: float | None = None) -> None:
                if swallowed.is_set():
                    super().put(item)
                else:
                    late.append(item)
                    swallowed.set()

            def get(self, block: bool = True, timeout: float | None = None) -> bytes:
                while late:
                    super().put(late.pop())
                return super().get(block, timeout)

        monkeypatch.setattr(sdo, "responses", Delayed())
        with impatient_node(node, monkeypatch), pytest.raises(LinkTimeout):
            node.get(field.name)
        assert swallowed.wait(10)
        monkeypatch.setitem(simulated.settings, field.name, number(field, new))
        assert node.get(field.name) == new != old
