"""Micro-positioner, Modbus RTU, on the strain indicator's line. Our own map.

Target, speed and command lie side by side, so that one FC16 starts a move and the device never moves to a half-written
target.
"""

from __future__ import annotations

from palpate.instrument.contracts.contract import Contract, Field, Identity, probe

CONTRACT = Contract(
    name="positioner",
    title="micro-positioner",
    bus="modbus",
    identity=Identity("Palpate", "MP-1", "1.0"),
    about=__doc__,
    fields=(
        probe(0x00),
        Field("target", 0x10, "int32", "target position, counted downwards from home", "m", 1e-6, "rw", 0, 0.025),
        Field("speed", 0x12, "uint16", "speed of a move", "m/s", 1e-6, "rw", 1e-6, 5e-3, 1e-3),
        Field("command", 0x13, "uint16", "write a command; reads idle once it is taken", access="rw",
              choices={"idle": 0, "move": 1, "stop": 2, "home": 3}),
        Field("limit_low", 0x14, "int32", "lower soft limit", "m", 1e-6, "rw", 0, 0.025),
        Field("limit_high", 0x16, "int32", "upper soft limit", "m", 1e-6, "rw", 0, 0.025, 0.025),
        Field("position", 0x20, "int32", "present position", "m", 1e-6),
        Field("status", 0x22, "uint16", "status word", bits={"moving": 0, "homed": 1, "at_limit": 2}),
    ),
)  # fmt: skip
