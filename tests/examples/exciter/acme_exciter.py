"""Acme GA-5, a signal generator and power amplifier in one, Modbus TCP: registers as in its manual; no watchdog."""

from palpate.extend import (
    DEVICE_FAILURE,
    Contract,
    DeviceKind,
    Exciter,
    Field,
    Identity,
    ModbusDevice,
    Refused,
    Rig,
    SafetyError,
    SimulatedDevice,
    probe,
    sine,
)

CONTRACT = Contract("acme-exciter", "exciter", "modbus", Identity("Acme", "GA-5", "1.0"), (
    probe(0x00),
    Field("frequency", 0x10, "uint32", "of the sine", "Hz", 1e-3, "rw", 0, 1000, 10),
    Field("amplitude", 0x12, "uint16", "peak, before the amplifier", "V", 1e-3, "rw", 0, 10, 0),
    Field("output", 0x13, "uint16", "output stage", access="rw", choices={"off": 0, "on": 1}),
    Field("current", 0x20, "uint16", "peak", "A", 1e-3),
    Field("tripped", 0x21, "uint16", "latched until the output is switched off", choices={"no": 0, "yes": 1}),
), about=__doc__ or "")  # fmt: skip
GAIN, LIMIT = 2.0, 5.0  # V/V; A, peak


class AcmeExciter(ModbusDevice, Exciter):
    contract = CONTRACT

    def sine(self, frequency: float, amplitude: float) -> None:
        self.set(frequency=frequency, amplitude=amplitude)

    def drive(self) -> None:
        self.set(frequency=10.0, amplitude=0.0, output="on")

    def rest(self) -> None:
        self.set(amplitude=0.0, output="off")

    def check(self) -> None:
        if self.get("tripped"):
            raise SafetyError(f"{self.name}: has tripped; remove the cause and run again")

    def effort(self) -> float:
        self.check()
        return self.get("current")

    def effort_limit(self) -> float:
        return LIMIT


class SimulatedExciter(SimulatedDevice):
    contract = CONTRACT
    rig: Rig

    def write(self, values: dict[str, float]) -> None:
        if values.get("output") and self.settings["tripped"]:
            raise Refused(DEVICE_FAILURE)
        self.settings |= values
        if values.get("output") == 0.0:
            self.settings["tripped"] = 0.0
        if self._peak() / self.rig.scene.rig.coil_resistance > LIMIT:
            self.settings |= {"output": 0.0, "tripped": 1.0}
        now = self.clock.now_ns()
        self.rig.set_voltage(sine(self.settings["frequency"], self._peak(), now, self.rig.coil_voltage()))

    def _peak(self) -> float:
        return GAIN * self.settings["amplitude"] * self.settings["output"]

    def trip(self, fault: str) -> None:
        self.turn({"output": 0.0})
        self.settings["tripped"] = 1.0

    def read(self, name: str) -> float:
        return self._peak() / self.rig.scene.rig.coil_resistance if name == "current" else super().read(name)


KIND = DeviceKind(
    CONTRACT, ("modbus-tcp",), "acme_exciter:AcmeExciter", "acme_exciter:SimulatedExciter", roles=("exciter",),
    frequency_step=CONTRACT["frequency"].scale,
)  # fmt: skip
