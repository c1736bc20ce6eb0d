"""Frames that were written down by hand from a device's manual, held against driver and simulator."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, ClassVar

import pytest

from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.procedures.testing.wire import Wire
from palpate.simulators.wire.device import SimulatedDevice


class GoldenFrames:
    """Beside a Modbus conformance suite: the registers travel as they stand in `golden`, a TOML file.

    A scale, sign or width that is wrong in the contract is wrong at both ends, and passes every other test.
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
                    patch.setattr(device, "_last_count", 0)  # as if it were the first: nothing else is read with it
                    assert device.get(name) == value
                frames = (wire.requests[-1], wire.replies[-1])
                assert frames == (bytes.fromhex(golden["request"]), bytes.fromhex(golden["response"])), name
