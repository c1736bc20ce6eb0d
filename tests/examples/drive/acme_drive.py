"""Acme TD-1, a torque drive with a function generator, CANopen: objects after CiA 402, 2100h ff. as in its manual."""

from typing import Any

from palpate.extend import (
    CanopenDevice,
    Contract,
    DeviceKind,
    Exciter,
    Field,
    Identity,
    Pdo,
    Rig,
    SafetyError,
    SimulatedNode,
    probe,
    sdo,
    sine,
)

CONTRACT = Contract("acme-drive", "torque drive", "canopen", Identity("0x00000ACE", "0x00070D01", "0x00010000"), (
    Field("device_type", sdo(0x1000), "uint32", "CiA 402, drive", default=0x0002_0192),
    Field("error_register", sdo(0x1001), "uint8", "error register", bits={"generic": 0, "current": 1}),
    Field("hardware_version", sdo(0x1009), "text", "hardware version", default="1.0"),
    Field("emergency_cob_id", sdo(0x1014), "uint32", "COB-ID of emergencies", default=0x80),
    Field("heartbeat", sdo(0x1017), "uint16", "heartbeat period", "s", 1e-3, "rw", 0, 60, 0.5),
    Field("vendor", sdo(0x1018, 1), "uint32", "vendor id", default=0xACE),
    Field("product", sdo(0x1018, 2), "uint32", "product code", default=0x00070D01),
    Field("revision", sdo(0x1018, 3), "uint32", "revision", default=0x00010000),
    Field("serial", sdo(0x1018, 4), "uint32", "serial number"),
    Field("rpdo1_cob_id", sdo(0x1400, 1), "uint32", "COB-ID of RPDO 1", default=0x200),
    Field("rpdo1_type", sdo(0x1400, 2), "uint8", "transmission type", default=255),
    Field("tpdo1_cob_id", sdo(0x1800, 1), "uint32", "COB-ID of TPDO 1", default=0x180),
    Field("tpdo1_type", sdo(0x1800, 2), "uint8", "transmission type: 1 is at every SYNC", default=1),
    probe(sdo(0x2000)),
    Field("frequency", sdo(0x2100), "uint32", "of the sine", "Hz", 1e-3, "rw", 0, 1000, 10),
    Field("amplitude", sdo(0x2101), "uint16", "peak of the input", "V", 1e-3, "rw", 0, 10, 0),
    Field("controlword", sdo(0x6040), "uint16", "CiA 402", access="rw", choices={"off": 6, "on": 15}, default=6),
    Field("statusword", sdo(0x6041), "uint16", "CiA 402", bits={"enabled": 2, "fault": 3}),
    Field("torque", sdo(0x6077), "int16", "peak of the torque, of the rated torque", "%", 0.1),
), pdos=(Pdo("state", 0x180, ("statusword", "torque")),), about=__doc__ or "",
   receives=(Pdo("command", 0x200, ("controlword", "amplitude")),))  # fmt: skip
GAIN, PER_AMPERE, LIMIT = 2.0, 20.0, 100.0  # V/V, %/A, %


class Drive(CanopenDevice, Exciter):
    contract = CONTRACT
    unit = "%"

    def sine(self, frequency: float, amplitude: float) -> None:
        self.set("frequency", frequency)
        self.set("amplitude", amplitude)

    def drive(self) -> None:
        self.start()
        self.send("command", controlword="on", amplitude=0.0)

    def rest(self) -> None:
        self.set("amplitude", 0.0)
        self.set("controlword", "off")

    def check(self) -> None:
        if "fault" in self.contract.set_bits("statusword", self.get("statusword")):
            raise SafetyError(f"{self.name}: is in fault; switch it off and on")

    def effort(self) -> float:
        self.check()
        return self.get("torque")

    def effort_limit(self) -> float:
        return LIMIT


class SimulatedDrive(SimulatedNode):
    contract = CONTRACT
    rig: Rig
    fault = False

    def write(self, field: Field, value: float) -> None:
        super().write(field, value)
        now, before = self.clock.now_ns(), self.rig.coil_voltage()
        self.rig.set_voltage(sine(self.settings["frequency"], self.volts, now, before))

    @property
    def volts(self) -> float:
        on = self.settings["controlword"] == CONTRACT["controlword"].choices["on"] and not self.fault
        return GAIN * self.settings["amplitude"] * on

    def trip(self, fault: str) -> None:
        self.fault = True
        self.settings["error_register"] = 0b11
        self.write(CONTRACT["amplitude"], 0.0)
        self.emergency(0x2310)  # continuous over current
        self.transmit("state")

    def read(self, field: Field) -> Any:
        if field.name == "torque":
            return round(PER_AMPERE * self.volts / self.rig.scene.rig.coil_resistance / field.scale)
        return (self.volts > 0) << 2 | self.fault << 3 if field.name == "statusword" else super().read(field)


KIND = DeviceKind(CONTRACT, ("canopen",), "acme_drive:Drive", "acme_drive:SimulatedDrive", roles=("exciter",))
