"""Tests driver and simulator against golden frames, which were written by hand from the device's manual."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import can
import pytest

from palpate.drivers.devices.canopen_device import CanopenDevice
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.config import read_data
from palpate.procedures.testing.wire import Wire, transfers
from palpate.simulators.wire.canopen_device import SimulatedNode
from palpate.simulators.wire.device import SimulatedDevice


class GoldenFrames:
    """Added to a Modbus conformance suite: each register must travel as in the golden frames.

    A scale, sign or width that is wrong in the contract is wrong in driver and simulator, and passes every other test.

    Attributes:
        golden: a TOML file with a frame for each field of the contract.
    """

    golden: ClassVar[Path]

    def test_every_register_travels_as_its_golden_frame(
        self, device: ModbusDevice, simulated: SimulatedDevice, wire: Wire, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        fields: dict[str, Any] = read_data(self.golden)["fields"]
        assert set(fields) == {field.name for field in device.contract.fields}
        for name, golden in fields.items():
            field, value = device.contract[name], golden["value"]
            if field.bits:
                value = sum(1 << field.bits[bit] for bit in value)
            if "write" in golden:
                device.set(**{name: value})
                assert wire.requests[-1] == bytes.fromhex(golden["write"]), name
            else:
                with monkeypatch.context() as patch:
                    patch.setattr(simulated, "read", {name: value}.__getitem__)
                    patch.setattr(device, "_last_count", 0)  # so that the driver reads this register alone
                    assert device.get(name) == value
                frames = (wire.requests[-1], wire.replies[-1])
                assert frames == (bytes.fromhex(golden["request"]), bytes.fromhex(golden["response"])), name


class CanopenGoldenFrames:
    """Added to the CANopen conformance suite: each object must travel in the SDO frames that stand in `golden`."""

    golden: ClassVar[Path]

    def test_every_object_travels_as_its_golden_frames(
        self,
        node: CanopenDevice,
        simulated: SimulatedNode,
        listener: can.BusABC,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        fields: dict[str, Any] = read_data(self.golden)["fields"]
        assert set(fields) == {field.name for field in node.contract.fields}
        for name, golden in fields.items():
            field, value = node.contract[name], golden.get("value")
            if "text" in golden:
                assert node._text(field.address) == golden["text"]
                requests, answers = transfers(listener, node.id)  # what is read twice travels alike
                assert requests[: len(golden["requests"])] == _frames(golden["requests"])
                assert answers[: len(golden["responses"])] == _frames(golden["responses"])
            elif "write" in golden:
                node.set(name, value)
                assert transfers(listener, node.id)[0] == _frames([golden["write"]]), name
            else:
                number = sum(1 << field.bits[bit] for bit in value) if field.bits else value
                raw = round(number / field.scale)
                with monkeypatch.context() as patch:
                    patch.setattr(simulated, "read", lambda _field, raw=raw: raw)
                    assert node.get(name) == number
                assert transfers(listener, node.id) == (_frames([golden["request"]]), _frames([golden["response"]])), (
                    name
                )


def _frames(texts: list[str]) -> list[bytes]:
    return [bytes.fromhex(text) for text in texts]
