"""Signal generator, Modbus TCP. Our own map, after generators that take a u32 frequency with FC16 (Waveshare).

Frequency, amplitude and offset lie side by side, so that one write changes them together. The device has no owner, but
counts the writes that it takes, so that a client notices when another one writes.
"""

from __future__ import annotations

from palpate.instrument.contracts.contract import Contract, Field, Identity, probe

LARGEST_PEAK = 10.0  # V, amplitude + |offset|

CONTRACT = Contract(
    name="signal_generator",
    title="signal generator",
    bus="modbus",
    identity=Identity("Palpate", "SG-1", "1.0"),
    about=__doc__,
    fields=(
        probe(0x00),
        Field("writes", 0x0E, "uint32", "writes that were taken since power-on, from anybody or at the front panel; "
              "refused ones do not count"),
        Field("frequency", 0x10, "uint32", "frequency of the waveform", "Hz", 1e-3, "rw", 0, 20_000, 10),
        Field("amplitude", 0x12, "uint32", "peak amplitude", "V", 1e-6, "rw", 0, 10),
        Field("offset", 0x14, "int32", "DC offset; amplitude + |offset| is at most 10 V", "V", 1e-6, "rw", -10, 10),
        Field("waveform", 0x16, "uint16", "shape; square and triangle are band-limited to 25 harmonics",
              access="rw", choices={"sine": 0, "square": 1, "triangle": 2}),
        Field("output", 0x17, "uint16", "output relay", access="rw", choices={"off": 0, "on": 1}),
        Field("phase_reset", 0x18, "uint16", "write 1 to restart the waveform at zero phase",
              access="wo", minimum=1, maximum=1),
        Field("status", 0x19, "uint16", "status word", bits={"output_on": 0}),
        Field("error", 0x1A, "uint16", "why the last refused write was refused",
              choices={"none": 0, "range": 1, "amplitude_plus_offset": 2}),
    ),
)  # fmt: skip
