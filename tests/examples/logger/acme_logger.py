"""Acme DL-4, a data logger of four channels, Modbus TCP: it records into its memory, which is read in blocks."""

from collections.abc import Sequence

import numpy as np

from palpate.extend import (
    Contract,
    DeviceError,
    DeviceKind,
    Field,
    Identity,
    ModbusDevice,
    Recording,
    Rig,
    SimulatedDevice,
    place,
    probe,
)

CHANNELS, BLOCK = 4, 24
FULL, RANGES = 32767, {"10 V": 10.0, "1 V": 1.0}
SAMPLES = tuple(f"sample_{row}_{channel}" for row in range(BLOCK) for channel in range(1, CHANNELS + 1))
CONTRACT = Contract("acme-logger", "data logger", "modbus", Identity("Acme", "DL-4", "1.0"), (
    probe(0x00),
    Field("rate", 0x10, "uint32", "samples a second", "Hz", 1e-3, "rw", 1, 20_000, 1000),
    *(Field(f"range_{channel}", 0x11 + channel, "uint16", "input range", access="rw",
            choices={name: raw for raw, name in enumerate(RANGES)}) for channel in range(1, CHANNELS + 1)),
    Field("start", 0x20, "uint32", "write how many samples to record", access="rw", minimum=0, maximum=1e6),
    Field("recorded", 0x22, "uint32", "samples in memory"),
    Field("first", 0x24, "uint32", "sample with which the block begins", access="rw", minimum=0, maximum=1e6),
    *(Field(name, 0x100 + number, "int16", "one sample") for number, name in enumerate(SAMPLES)),
), about=__doc__ or "")  # fmt: skip


class Logger(ModbusDevice):
    contract = CONTRACT
    orders = frozenset({"start", "first"})
    ranges = RANGES
    emergencies: Sequence[bytes] = ()

    def set_sample_rate(self, rate: float) -> None:
        self.set(rate=rate)

    def set_range(self, channel: int, range_: str) -> None:
        self.set(**{f"range_{channel}": range_})

    def resolution(self, channel: int) -> float:
        return RANGES[str(self._settings[f"range_{channel}"])] / FULL

    def acquire_with(self, others: Sequence["Logger"], duration: float) -> list[Recording]:
        count = round(duration * self.get("rate"))
        for each in (self, *others):
            each.set(start=count)
        self.clock.wait(duration)
        return [each.collect(count) for each in (self, *others)]

    def collect(self, count: int) -> Recording:
        if self.get("recorded") < count:
            raise DeviceError(f"{self.name}: has recorded less than {count} samples; look at its trigger")
        rows: list[list[float]] = []
        for first in range(0, count, BLOCK):
            self.set(first=first)
            rows += np.reshape(self.get_many(*SAMPLES), (BLOCK, CHANNELS)).tolist()
        counts = np.array(rows[:count]).T
        names = [f"range_{channel}" for channel in range(1, CHANNELS + 1)]
        full = np.array([list(RANGES.values())[int(self.get(name))] for name in names])
        time, rate = np.arange(1, count + 1), self.get("rate")
        return Recording(self.unit, rate, time / rate, counts * full[:, None] / FULL, np.abs(counts) >= FULL)


class SimulatedLogger(SimulatedDevice):
    contract = CONTRACT
    rig: Rig
    began_ns = 0

    def write(self, values: dict[str, float]) -> None:
        super().write(values)
        if "start" in values:
            self.began_ns, self.memory = self.clock.now_ns(), np.zeros((0, CHANNELS))

    def read(self, name: str) -> float:
        if name == "recorded":
            return float(len(self.recorded()))
        if not name.startswith("sample_"):
            return super().read(name)
        row, channel = map(int, name.split("_")[1:])
        row += int(self.settings["first"])
        return float(self.memory[row, channel - 1]) if row < len(self.memory) else 0.0

    def recorded(self) -> np.ndarray:
        step = round(1e9 / self.settings["rate"])
        count = min(int(self.settings["start"]), (self.clock.now_ns() - self.began_ns) // step)
        self.memory = np.zeros((count, CHANNELS))
        if count:
            volts = self.rig.film_voltages(self.began_ns + step * np.arange(1, count + 1), step)
            for film, signal in zip(self.rig.scene.design.films, volts, strict=True):
                channel = place(film.channel, CHANNELS)[1]
                full = list(RANGES.values())[int(self.settings[f"range_{channel}"])]
                self.memory[:, channel - 1] = np.clip(np.round(signal / full * FULL), -FULL, FULL)
        return self.memory


KIND = DeviceKind(
    CONTRACT,
    ("modbus-tcp",),
    "acme_logger:Logger",
    "acme_logger:SimulatedLogger",
    roles=("sensor_node",),
    channels=CHANNELS,
)
