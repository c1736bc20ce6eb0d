"""Acme OV-60, an oven around the sensor, Modbus TCP: registers as in its manual."""

from palpate.extend import Contract, DeviceKind, Field, Identity, ModbusDevice, SimulatedDevice, probe

CONTRACT = Contract("acme-oven", "oven", "modbus", Identity("Acme", "OV-60", "1.0"), (
    probe(0x00),
    Field("setpoint", 0x10, "int16", "asked for", "degC", 0.1, "rw", 0, 60, 20),
    Field("heater", 0x11, "uint16", "heater", access="rw", choices={"off": 0, "on": 1}),
    Field("temperature", 0x20, "int16", "inside", "degC", 0.1),
), about=__doc__ or "")  # fmt: skip
ROOM = 20.0  # degC


class Oven(ModbusDevice):
    contract = CONTRACT

    def warm(self, kelvin: float) -> None:
        self.set(setpoint=ROOM + kelvin, heater="on" if kelvin else "off")

    def off(self) -> None:
        self.set(setpoint=ROOM, heater="off")

    def temperature(self) -> float:
        return self.get("temperature")


class SimulatedOven(SimulatedDevice):
    contract = CONTRACT
    readings = ("temperature",)

    def read(self, name: str) -> float:
        if name == "temperature":  # at once: it is a small oven
            return self.settings["setpoint"] if self.settings["heater"] else ROOM
        return super().read(name)


KIND = DeviceKind(CONTRACT, ("modbus-tcp",), "acme_oven:Oven", "acme_oven:SimulatedOven", roles=("chamber",))
