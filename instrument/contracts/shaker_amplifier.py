"""Shaker amplifier, Modbus TCP. Our own map, after bench supplies (Riden RD6006: enable and protection
registers) and power amplifiers (Hubert A1230: live and latched fault bits).

A client that reads a ticket and writes it back as token owns the amplifier, until it releases it, or until another
client claims it after the watchdog's time. The owner writes settings as orders, with the token and a rising counter.
The device refuses orders that come late or twice, and all writes of others except switching the output off. While the
amplifier has no owner, any request feeds the watchdog.
"""

from __future__ import annotations

from palpate.instrument.contracts.contract import Contract, Field, Identity, probe

SETTINGS = {"gain": 0x10, "current_limit": 0x11, "enable": 0x12, "clear_faults": 0x13, "watchdog": 0x14}
WHOLE = 2**32 - 1
FAULTS = {"over_current": 0, "over_temperature": 1, "supply": 2, "interlock": 3, "watchdog": 4}

CONTRACT = Contract(
    name="shaker_amplifier",
    title="shaker amplifier",
    bus="modbus",
    identity=Identity("Palpate", "PA-1", "1.0"),
    about=__doc__,
    fields=(
        probe(0x00),
        Field("gain", 0x10, "uint16", "voltage gain", "V/V", 0.01, "rw", 0, 20, 2),
        Field("current_limit", 0x11, "uint16", "peak output current at which the output trips", "A", 1e-3,
              "rw", 0.1, 6, 5),
        Field("enable", 0x12, "uint16", "output stage; refused while a fault is latched", access="rw",
              choices={"off": 0, "on": 1}),
        Field("clear_faults", 0x13, "uint16", "write 1 to clear latched faults", access="wo",
              minimum=1, maximum=1),
        Field("watchdog", 0x14, "uint16", "output drops when it is not fed for this long; 0 is never",
              "s", 1e-3, "rw", 0, 60),
        Field("output_current", 0x20, "uint16", "output current, rms", "A", 1e-3),
        Field("output_voltage", 0x21, "uint16", "output voltage, rms", "V", 1e-2),
        Field("temperature", 0x22, "int16", "heat sink temperature", "degC", 0.1,
              minimum=-40, maximum=150),
        Field("faults", 0x23, "uint16", "faults present now", bits=FAULTS),
        Field("faults_latched", 0x24, "uint16", "faults since they were last cleared", bits=FAULTS),
        Field("status", 0x25, "uint16", "status word", bits={"enabled": 0, "owned": 1}),
        Field("ticket", 0x30, "uint32", "a new number at each reading, by which the amplifier may be claimed"),
        Field("token", 0x40, "uint32", "a ticket, from then on the owner's sign; with a counter it feeds the watchdog",
              access="wo", minimum=1, maximum=WHOLE),
        Field("counter", 0x42, "uint32", "above the last one of this token; orders are counted apart",
              access="wo", minimum=1, maximum=WHOLE),
        Field("order", 0x44, "uint16", "register of the setting that the owner writes", access="wo", choices=SETTINGS),
        Field("order_value", 0x45, "uint16", "what is written there", access="wo", minimum=0, maximum=65535),
        Field("release", 0x48, "uint32", "the owner's token: output off, and nobody's from now on", access="wo",
              minimum=1, maximum=WHOLE),
    ),
)  # fmt: skip
