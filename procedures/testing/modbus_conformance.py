"""Tests that every Modbus device kind must pass, with its driver and its simulator."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

import pytest
from pymodbus.exceptions import ModbusIOException

from palpate.drivers.bench import Bench
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.contracts.declaration import Identity
from palpate.instrument.contracts.field import PROBE
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
from palpate.procedures.testing.wire import Wire, impatient, listen
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.wire.device import DEVICE_FAILURE, Refused, SimulatedDevice

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
SWAPPED_PROBE = 0x56781234


class ModbusConformance(Conformance):
    """Tests of a driver and its simulated device, through the bench and over the wire."""

    @pytest.fixture
    def device(self, bench: Bench, sim: SimulatedBench) -> ModbusDevice:
        device: ModbusDevice = self.ends(bench, sim)[0]
        return device

    @pytest.fixture
    def wire(self, device: ModbusDevice, monkeypatch: pytest.MonkeyPatch) -> Wire:
        return listen(device.link, monkeypatch)

    @pytest.fixture
    def write(self, device: ModbusDevice) -> Callable[[int, list[int]], int]:
        """Write registers like any Modbus client, without the driver's checks; returns the exception code, or 0."""

        def write(address: int, registers: list[int]) -> int:
            reply = device.link.client.write_registers(address, registers, device_id=device.unit)
            return reply.exception_code if reply.isError() else 0

        return write

    def test_its_identity_is_checked_and_its_serial_number_read(
        self, device: ModbusDevice, simulated: SimulatedDevice
    ) -> None:
        device.serial = ""
        device.connect()
        assert device.serial == simulated.serial

    @pytest.mark.parametrize("change", [{"vendor": "Somebody else"}, {"product": "XY-9"}, {"revision": "2.0"}])
    def test_another_identity_is_refused(
        self,
        change: dict[str, str],
        device: ModbusDevice,
        simulated: SimulatedDevice,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        contract = device.contract
        monkeypatch.setattr(simulated, "contract", replace(contract, identity=replace(contract.identity, **change)))
        expected = f"{contract.title} at .*{next(iter(change.values()))}.*{contract.identity.product}.*bench file"
        with pytest.raises(IdentityError, match=expected):
            device.connect()

    def test_a_later_minor_revision_is_accepted(
        self, device: ModbusDevice, simulated: SimulatedDevice, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        identity = Identity(device.contract.identity.vendor, device.contract.identity.product, "1.7")
        monkeypatch.setattr(simulated, "contract", replace(device.contract, identity=identity))
        device.connect()

    def test_another_word_order_is_refused_with_the_remedy(
        self, device: ModbusDevice, simulated: SimulatedDevice, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setitem(simulated.settings, "probe", float(SWAPPED_PROBE))
        with pytest.raises(IdentityError, match=r"0x56781234.*set the device to big-endian words"):
            device.connect()

    def test_every_setting_reads_back_as_it_was_written(self, device: ModbusDevice) -> None:
        for field in settings(device.contract):
            before = device.get(field.name)
            for value in [*inside(field), before]:
                device.set(**{field.name: value})
                assert device.get(field.name) == number(field, value), field.name

    def test_a_value_out_of_range_is_refused_before_anything_is_sent(self, device: ModbusDevice, wire: Wire) -> None:
        for field in writable(device.contract):
            for value in outside(field):
                with pytest.raises(RangeError, match=f"{device.contract.title}: {field.name} = "):
                    device.set(**{field.name: value})
        assert wire.requests == []

    def test_the_device_itself_refuses_a_value_out_of_range(
        self, device: ModbusDevice, simulated: SimulatedDevice, write: Callable[[int, list[int]], int]
    ) -> None:
        for field in writable(device.contract):
            before = dict(simulated.settings)
            for raw, _ in outside_raw(field):
                data = raw.to_bytes(field.size, signed=raw < 0)
                registers = [int.from_bytes(data[i : i + 2]) for i in range(0, field.size, 2)]
                assert write(field.address, registers) == ILLEGAL_VALUE, (field.name, raw)
                assert simulated.settings.get(field.name) == before.get(field.name)

    def test_the_device_refuses_a_write_to_what_is_read_only(
        self, device: ModbusDevice, write: Callable[[int, list[int]], int]
    ) -> None:
        for field in device.contract.fields:
            if field.access == "ro":
                assert write(field.address, [0] * (field.size // 2)) == ILLEGAL_ADDRESS, field.name

    def test_the_device_refuses_half_of_a_value(
        self, device: ModbusDevice, write: Callable[[int, list[int]], int]
    ) -> None:
        for field in writable(device.contract):
            if field.size >= 4:
                assert write(field.address, [0]) == ILLEGAL_VALUE, field.name
                assert write(field.address + 1, [0]) == ILLEGAL_VALUE, field.name

    def test_a_refused_write_changes_nothing_at_all(
        self, device: ModbusDevice, simulated: SimulatedDevice, write: Callable[[int, list[int]], int]
    ) -> None:
        """One write holds two adjacent fields; the first value is allowed, and the second is not."""
        for one, other in zip(device.contract.fields, device.contract.fields[1:], strict=False):
            adjacent = other.address == one.address + one.size // 2
            if not adjacent or one not in settings(device.contract) or not outside_raw(other):
                continue
            before = dict(simulated.settings)
            good = device.contract.encode(one.name, inside(one)[-1])
            bad = outside_raw(other)[-1][0].to_bytes(other.size)
            data = good + bad
            refusal = write(one.address, [int.from_bytes(data[i : i + 2]) for i in range(0, len(data), 2)])
            assert refusal in (ILLEGAL_VALUE, ILLEGAL_ADDRESS), (one.name, other.name)
            assert simulated.settings[one.name] == before[one.name]

    def test_the_device_refuses_an_unknown_address(
        self, device: ModbusDevice, write: Callable[[int, list[int]], int]
    ) -> None:
        addresses = {f.address + i for f in device.contract.fields for i in range(f.size // 2)}
        unknown = [*(a for a in range(max(addresses)) if a not in addresses), max(addresses) + 1, 0x7000, 0xFFFF]
        for address in unknown:
            assert write(address, [0]) == ILLEGAL_ADDRESS, address
            reply = device.link.client.read_holding_registers(address, count=1, device_id=device.unit)
            assert reply.exception_code == ILLEGAL_ADDRESS, address

    def test_the_device_knows_no_coils_and_no_input_registers(
        self, device: ModbusDevice, simulated: SimulatedDevice
    ) -> None:
        """All registers are holding registers, so that no other table can read or write them."""
        client, unit, before = device.link.client, device.unit, dict(simulated.settings)
        for field in writable(device.contract):
            replies = [
                client.read_coils(field.address, count=1, device_id=unit),
                client.read_discrete_inputs(field.address, count=1, device_id=unit),
                client.read_input_registers(field.address, count=1, device_id=unit),
                client.write_coil(field.address, True, device_id=unit),
                client.write_coils(field.address, [True], device_id=unit),
                client.mask_write_register(address=field.address, and_mask=0, or_mask=1, device_id=unit),
                client.readwrite_registers(
                    read_address=0, read_count=1, address=field.address, values=[1], device_id=unit
                ),
            ]
            assert {reply.exception_code for reply in replies} == {ILLEGAL_FUNCTION}, field.name
        assert simulated.settings == before

    def test_a_refusal_names_device_field_value_and_limit(
        self, device: ModbusDevice, simulated: SimulatedDevice, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def refuse(*_: object) -> None:
            raise Refused(DEVICE_FAILURE)

        monkeypatch.setattr(simulated, "write", refuse)
        monkeypatch.setattr(simulated, "write_text", refuse)
        for field in writable(device.contract):
            value = inside(field)[0]
            limits = ", ".join(field.choices) or (
                f"text of up to {field.length} bytes" if field.length else f"{field.minimum:g} to {field.maximum:g}"
            )
            with pytest.raises(DeviceError) as failure:
                device.set(**{field.name: value})
            message = str(failure.value)
            assert message.startswith(f"{device.name}: answered exception 4, device failure")
            assert re.search(rf"{field.name} = {value}.*\({re.escape(limits)}\)", message), message

    def test_a_refused_read_names_device_and_field(
        self, device: ModbusDevice, simulated: SimulatedDevice, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def refuse(_: str) -> float:
            raise Refused(DEVICE_FAILURE)

        monkeypatch.setattr(simulated, "read", refuse)
        with pytest.raises(DeviceError, match=f"^{re.escape(device.name)}: answered exception 4.*probe"):
            device.get("probe")

    def test_a_write_that_gets_no_answer_is_not_repeated(
        self,
        device: ModbusDevice,
        simulated: SimulatedDevice,
        sim: SimulatedBench,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        field = first(settings(device.contract), "setting")
        writes: list[dict[str, float]] = []
        monkeypatch.setattr(simulated, "write", writes.append)
        wire = listen(device.link, monkeypatch)
        with impatient(device.link):
            with sim.clock.lock:  # the device stalls
                with pytest.raises(LinkTimeout, match=f"^{re.escape(device.name)}: no valid answer .* within 0.2 s"):
                    device.set(**{field.name: inside(field)[1]})
                assert len(wire.requests) == 1
            device.link.open()
        device.get("probe")
        assert len(writes) == 1

    def test_a_late_reply_never_answers_the_next_request(
        self, device: ModbusDevice, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The reply to the first request comes just after the link was opened again for the second request."""
        client = device.link.client
        readable = [f for f in device.contract.fields if f.access != "wo" and f.type != "text" and f.name != "probe"]
        field = first([*settings(device.contract), *readable], "register beside the probe")
        wanted = device.get(field.name)
        others = [
            f for f in device.contract.fields if f.size == field.size and f.name != field.name and f.access != "wo"
        ]
        other = first(others, "two registers of one size")
        connect = client.connect
        with impatient(device.link), ExitStack() as stall:

            def reconnect() -> bool:
                connected: bool = connect()
                stall.close()
                return connected

            stall.enter_context(sim.clock.lock)
            with pytest.raises(LinkTimeout):
                device.get(other.name)
            monkeypatch.setattr(client, "connect", reconnect)
            device.link.open()
        assert device.get(field.name) == wanted
        assert device.get("probe") == PROBE


class RtuConformance(ModbusConformance):
    """The same tests for a device on a serial line with other units."""

    def test_an_absent_unit_on_the_line_is_silent(self, device: ModbusDevice) -> None:
        client = device.link.client
        asks: list[Callable[[], object]] = [
            lambda: client.read_holding_registers(0, count=2, device_id=99),
            lambda: client.read_device_information(read_code=3, device_id=99),
        ]
        for ask in asks:
            with impatient(device.link), pytest.raises(ModbusIOException):
                ask()
