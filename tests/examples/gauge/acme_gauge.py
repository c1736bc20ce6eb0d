"""Acme FG-20, a bridge amplifier with a display, Modbus RTU: registers as in its manual."""

import math
from dataclasses import dataclass

import numpy as np

from palpate.extend import Contract, DeviceKind, Field, Identity, ModbusDevice, Rig, SimulatedDevice, probe

CONTRACT = Contract("acme-gauge", "force gauge", "modbus", Identity("Acme", "FG-20", "1.0"), (
    probe(0x00),
    Field("mode", 0x10, "uint16", "what is shown", access="rw", choices={"mean": 0, "peak_to_peak": 1}),
    Field("window", 0x11, "uint16", "over which it is formed", "s", 1e-3, "rw", 0.01, 10, 0.1),
    Field("tare", 0x12, "int16", "taken off what is shown", "mV", 1e-2, "rw", -300, 300, 0),
    Field("shown", 0x20, "int32", "reading", "mV", 1e-3),
    Field("steady", 0x22, "uint16", "whether the window holds one load", choices={"no": 0, "yes": 1}),
), about=__doc__ or "")  # fmt: skip
RATE_NS, PER_NEWTON = 500_000, 10.306  # between samples; mV/N


@dataclass(frozen=True, slots=True)
class GaugeReading:
    reading_mV: float
    resolution_mV: float
    stable: bool
    sick: str = ""

    @property
    def valid(self) -> bool:
        return self.stable and math.isfinite(self.reading_mV)


class Gauge(ModbusDevice):
    contract = CONTRACT
    resolution_mV = 1e-3
    gage_factor = 1.0

    def read(self) -> GaugeReading:
        shown, steady = self.get_many("shown", "steady")
        return GaugeReading(shown, self.resolution_mV, bool(steady))

    def track(self, time_constant: float) -> None:
        self.set(mode="mean", window=time_constant)

    def peak_to_peak(self, window: float) -> None:
        self.set(mode="peak_to_peak", window=window)

    def clear_tare(self) -> None:
        self.set(tare=0.0)


class SimulatedGauge(SimulatedDevice):
    contract = CONTRACT
    readings = ("shown",)
    rig: Rig

    def read(self, name: str) -> float:
        now, window_ns = self.clock.now_ns(), round(self.settings["window"] * 1e9)
        if name == "steady":
            return float(self.rig.settled_for_ns() >= window_ns)
        if name != "shown":
            return super().read(name)
        force = self.rig.cell_force(now - np.arange(window_ns // RATE_NS, -1, -1) * RATE_NS, RATE_NS)
        load = np.ptp(force) if self.settings["mode"] else force.mean()
        return float(PER_NEWTON * load) - self.settings["tare"]


KIND = DeviceKind(CONTRACT, ("modbus-rtu",), "acme_gauge:Gauge", "acme_gauge:SimulatedGauge", roles=("load_indicator",))
