"""Shaker amplifier, Modbus TCP. Our own map, after bench supplies (Riden RD6006: enable and protection
registers) and power amplifiers (Hubert A1230: live and latched fault bits).
"""

from __future__ import annotations

from instrument.contract import Contract, Field, Identity, probe

FAULTS = {"over_current": 0, "over_temperature": 1, "supply": 2, "interlock": 3, "watchdog": 4}

CONTRACT = Contract(
    name="shaker_amplifier",
    title="shaker amplifier",
    bus="modbus",
    identity=Identity("Palpate", "PA-1", "1.0"),
    fields=(
        probe(0x00),
        Field("gain", 0x10, "uint16", "voltage gain", "V/V", 0.01, "rw", 0, 20, 2),
        Field("current_limit", 0x11, "uint16", "peak output current at which the output trips", "A", 1e-3,
              "rw", 0.1, 6, 5),
        Field("enable", 0x12, "uint16", "output stage; refused while a fault is latched", access="rw",
              choices={"off": 0, "on": 1}),
        Field("clear_faults", 0x13, "uint16", "write 1 to clear latched faults", access="wo",
              minimum=1, maximum=1),
        Field("watchdog", 0x14, "uint16", "output drops when no request comes for this long; 0 is never",
              "s", 1e-3, "rw", 0, 60),
        Field("output_current", 0x20, "uint16", "output current, rms", "A", 1e-3),
        Field("output_voltage", 0x21, "uint16", "output voltage, rms", "V", 1e-2),
        Field("temperature", 0x22, "int16", "heat sink temperature", "degC", 0.1,
              minimum=-40, maximum=150),
        Field("faults", 0x23, "uint16", "faults present now", bits=FAULTS),
        Field("faults_latched", 0x24, "uint16", "faults since they were last cleared", bits=FAULTS),
        Field("status", 0x25, "uint16", "status word", bits={"enabled": 0}),
    ),
)  # fmt: skip
