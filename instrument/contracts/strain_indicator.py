"""Strain indicator, Modbus RTU. Our own map, after load-cell transmitters.

Laumas TLB has status bits and the net reading as a 32-bit pair. With Dini Argeo the command register returns to idle
before a command can be repeated, and the status tells the last command and its result.
"""

from __future__ import annotations

from palpate.instrument.contracts.contract import Contract, Field, Identity, probe

COMMANDS = {"idle": 0, "zero": 1, "clear_zero": 2, "tare": 3, "clear_tare": 4}

CONTRACT = Contract(
    name="strain_indicator",
    title="strain indicator",
    bus="modbus",
    identity=Identity("Palpate", "SI-1", "1.0"),
    about=__doc__,
    fields=(
        probe(0x00),
        Field("gage_factor", 0x10, "uint16", "gage factor of the bridge", "", 1e-3, "rw", 0.5, 20, 8.98),
        Field("full_scale", 0x11, "uint16", "reading above which overload is flagged", "mV", 1, "rw", 10, 30_000,
              200),
        Field("filter", 0x12, "uint16", "time constant in mode track, window in mode peak_to_peak", "s", 1e-3,
              "rw", 0.01, 10, 0.1),
        Field("mode", 0x13, "uint16", "what the reading follows", access="rw",
              choices={"track": 0, "peak_to_peak": 1}),
        Field("command", 0x14, "uint16", "write a command; reads idle once it is carried out", access="rw",
              choices=COMMANDS),
        Field("last_command", 0x15, "uint16", "the command carried out last", choices=COMMANDS),
        Field("command_result", 0x16, "uint16", "how it ended; zero and tare need a stable reading",
              choices={"none": 0, "done": 1, "refused_unstable": 2}),
        Field("status", 0x20, "uint16", "status word",
              bits={"stable": 0, "overload": 1, "bridge_open": 2, "net": 3}),
        Field("decimals", 0x21, "uint16", "decimals of the integer reading: reading = integer / 10**decimals",
              minimum=0, maximum=9),
        Field("reading", 0x22, "int32", "reading, net of tare, in units of the last decimal", "mV"),
        Field("reading_float", 0x24, "float32", "the same reading, not a number while the bridge is open", "mV"),
        Field("updates", 0x26, "uint16", "how often the display was renewed, modulo 65536"),
    ),
)  # fmt: skip
