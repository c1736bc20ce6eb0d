"""Sensor array node, CANopen. Communication objects by CiA 301, channel objects after CiA 404 measuring
devices (Baumer: 6131 unit, 6132 digits, 7130 INT16 process value); 2000h to 2110h are our own.

A node samples its four channels at each SYNC and sends them in TPDO 1, then the sample's number and the
saturation flags in TPDO 2. The node that is SYNC producer (bit 30 of 1005h) sets the sample rate by its
cycle period (1006h).
"""

from __future__ import annotations

from collections.abc import Sequence

from palpate.instrument.contracts.contract import Contract, Field, Identity, Pdo, probe, sdo

CHANNELS = 4
SYNC_PRODUCER = 0x4000_0000
SYNC_COB_ID = 0x80
RANGES = {"5 V": 0, "500 mV": 1}
RANGE_VOLTS = (5.0, 0.5)
HEADROOM = 1.5  # least ratio of an input range to the greatest voltage expected there, where the range is chosen
LONGEST_WHOLE = 60.0  # s, the longest recording that is taken at once; a longer one comes in pieces
EMERGENCY = "emergency_cob_id"
SILENT = 0x8000_0000  # bit of a COB-ID that says that it is not used
FULL_SCALE_COUNTS = 32768
CLOCKS_APART = 0.0158


def _channel(name: str, index: int, type_: str, meaning: str, **rest: object) -> tuple[Field, ...]:
    return tuple(
        Field(f"{name}_{n}", sdo(index, n), type_, f"{meaning}, channel {n}", **rest)  # type: ignore[arg-type]
        for n in range(1, CHANNELS + 1)
    )


CONTRACT = Contract(
    name="sensor_node",
    title="sensor node",
    bus="canopen",
    identity=Identity("0x50414C50", "0x534E0001", "0x00010000"),
    about=__doc__,
    fields=(
        Field("device_type", sdo(0x1000), "uint32", "CiA 404, analogue inputs", default=0x0002_0194),
        Field("error_register", sdo(0x1001), "uint8", "error register", bits={"generic": 0, "voltage": 2}),
        Field("sync_cob_id", sdo(0x1005), "uint32", "COB-ID of SYNC; bit 30 makes this node its producer",
              access="rw", minimum=0, maximum=0xFFFF_FFFF, default=SYNC_COB_ID),
        Field("sync_period", sdo(0x1006), "uint32", "cycle period of SYNC, so the sample period", "s", 1e-6,
              "rw", 1e-4, 10, 1e-3),
        Field("device_name", sdo(0x1008), "text", "device name", default="Palpate SN-1"),
        Field("hardware_version", sdo(0x1009), "text", "hardware version; 'simulated' on a simulated node",
              default="1.0"),
        Field(EMERGENCY, sdo(0x1014), "uint32", "COB-ID of emergencies; bit 31: none are sent",
              minimum=0x81, maximum=0x8000_07FF, default=0x80),
        Field("heartbeat", sdo(0x1017), "uint16", "heartbeat period; 0 is none", "s", 1e-3, "rw", 0, 60, 1),
        Field("vendor", sdo(0x1018, 1), "uint32", "vendor id", default=0x50414C50),
        Field("product", sdo(0x1018, 2), "uint32", "product code", default=0x534E0001),
        Field("revision", sdo(0x1018, 3), "uint32", "revision", default=0x00010000),
        Field("serial", sdo(0x1018, 4), "uint32", "serial number", default=0),
        Field("tpdo1_cob_id", sdo(0x1800, 1), "uint32", "COB-ID of TPDO 1 (the samples)", default=0x180),
        Field("tpdo1_type", sdo(0x1800, 2), "uint8", "transmission type: 1 is at every SYNC", default=1),
        Field("tpdo2_cob_id", sdo(0x1801, 1), "uint32", "COB-ID of TPDO 2 (number and flags)", default=0x280),
        Field("tpdo2_type", sdo(0x1801, 2), "uint8", "transmission type: 1 is at every SYNC", default=1),
        probe(sdo(0x2000)),
        Field("sample_counter", sdo(0x2001), "uint32", "number of samples since the node was last started"),
        Field("saturation", sdo(0x2002), "uint8", "channels that saturated at the last sample",
              bits={f"channel_{n}": n - 1 for n in range(1, CHANNELS + 1)}),
        *_channel("range", 0x2100, "uint8", "charge amplifier range", access="rw", choices=RANGES),
        *_channel("reset", 0x2110, "uint8", "write 1 to short the integrator of the charge amplifier",
                  access="wo", minimum=1, maximum=1),
        *_channel("unit", 0x6131, "uint32", "unit of the process value: volt (CiA 303-2)", default=0x00260000),
        *_channel("digits", 0x6132, "uint8", "decimal digits of the process value"),
        *_channel("sample", 0x7130, "int16", "last sample; 32768 counts are the range"),
    ),
    pdos=(
        Pdo("samples", 0x180, tuple(f"sample_{n}" for n in range(1, CHANNELS + 1))),
        Pdo("stamp", 0x280, ("sample_counter", "saturation")),
    ),
)  # fmt: skip


def bus_load(nodes: int, rate: float, bitrate: float) -> float:
    """Greatest share of a classic CAN bus that SYNC and the samples of some nodes take.

    A frame of n data bytes has 47 + 8 n bits and its stuff bits. A real bus cannot carry a share above 1; a simulated
    bus loses frames then only with the effect `can_timing`.

    Args:
        nodes: number of nodes.
        rate: sample rate [Hz].
        bitrate: bits a second.
    """
    return frames_load(
        nodes * [sum(CONTRACT[name].size for name in pdo.fields) for pdo in CONTRACT.pdos], rate, bitrate
    )


def frames_load(sizes: Sequence[int], rate: float, bitrate: float) -> float:
    """Greatest share of a classic CAN bus that SYNC and the frames of so many bytes that follow it take; see above."""
    bits = sum(47 + 8 * n + stuff_bits(n) for n in (0, *sizes))
    return bits * rate / bitrate


def shortest_transfer(bitrate: float) -> float:
    """Shortest time [s] that an SDO request and its answer take on a classic bus.

    These are two frames of eight bytes without a stuffed bit, and the gap between them. A controller takes a frame one
    bit before its end (ISO 11898-1). Two clocks differ by 1.58 % at most.
    """
    frame, gap = 44 + 8 * 8, 3
    return (1 - CLOCKS_APART) * (2 * frame + gap - 1) / bitrate


def stuff_bits(size: int, stuffing: str = "worst") -> float:
    """Bits stuffed into a frame of `size` data bytes: the most there can be, or the "mean" of random data.

    34 + 8 n bits are watched (ISO 11898-1), and after five equal bits another one is inserted. In random data that
    happens once in 30 bits, in the mean.
    """
    watched = 34 + 8 * size
    return watched / 30 if stuffing == "mean" else float((watched - 1) // 4)


def place(channel: int, channels: int = CHANNELS) -> tuple[int, int]:
    """Number of the node and number of its channel, each from 1, to which a film's channel is wired.

    Args:
        channel: the film's channel, from 1.
        channels: number of channels of each node.
    """
    node, own = divmod(channel - 1, channels)
    return node + 1, own + 1
