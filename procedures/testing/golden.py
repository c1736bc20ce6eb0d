"""Tests driver and simulator against golden frames, which were written by hand from the device's manual."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, ClassVar

import pytest

from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.procedures.testing.wire import Wire
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
        fields: dict[str, Any] = tomllib.loads(self.golden.read_text(encoding="utf-8"))["fields"]
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
