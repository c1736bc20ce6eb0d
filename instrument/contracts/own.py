"""The contracts of the bench's six devices. The maps are our own; each names the real maps that it imitates."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.instrument.contracts.contract import Access, Contract, Field, Identity, Pdo, probe, sdo

# --- signal generator ----------------------------------------------------------------------------------

LARGEST_PEAK = 10.0  # V, amplitude + |offset|

SIGNAL_GENERATOR = Contract(
    name="signal_generator",
    title="signal generator",
    bus="modbus",
    identity=Identity("Palpate", "SG-1", "1.0"),
    about="""\
Signal generator, Modbus TCP. Our own map, after generators that take a u32 frequency with FC16 (Waveshare).

Frequency, amplitude and offset lie side by side, so that one write changes them together. The device has no owner, but
counts the writes that it takes, so that a client notices when another one writes.
""",
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


# --- shaker amplifier ----------------------------------------------------------------------------------

SETTINGS = {"gain": 0x10, "current_limit": 0x11, "enable": 0x12, "clear_faults": 0x13, "watchdog": 0x14}
WHOLE = 2**32 - 1
FAULTS = {"over_current": 0, "over_temperature": 1, "supply": 2, "interlock": 3, "watchdog": 4}

SHAKER_AMPLIFIER = Contract(
    name="shaker_amplifier",
    title="shaker amplifier",
    bus="modbus",
    identity=Identity("Palpate", "PA-1", "1.0"),
    about="""\
Shaker amplifier, Modbus TCP. Our own map, after bench supplies (Riden RD6006: enable and protection
registers) and power amplifiers (Hubert A1230: live and latched fault bits).

A client that reads a ticket and writes it back as token owns the amplifier, until it releases it, or until another
client claims it after the watchdog's time. The owner writes settings as orders, with the token and a rising counter.
The device refuses orders that come late or twice, and all writes of others except switching the output off. While the
amplifier has no owner, any request feeds the watchdog.
""",
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


# --- strain indicator ----------------------------------------------------------------------------------

COMMANDS = {"idle": 0, "zero": 1, "clear_zero": 2, "tare": 3, "clear_tare": 4}

STRAIN_INDICATOR = Contract(
    name="strain_indicator",
    title="strain indicator",
    bus="modbus",
    identity=Identity("Palpate", "SI-1", "1.0"),
    about="""\
Strain indicator, Modbus RTU. Our own map, after load-cell transmitters.

Laumas TLB has status bits and the net reading as a 32-bit pair. With Dini Argeo the command register returns to idle
before a command can be repeated, and the status tells the last command and its result.
""",
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


# --- positioner ----------------------------------------------------------------------------------------

POSITIONER = Contract(
    name="positioner",
    title="micro-positioner",
    bus="modbus",
    identity=Identity("Palpate", "MP-1", "1.0"),
    about="""\
Micro-positioner, Modbus RTU, on the strain indicator's line. Our own map.

Target, speed and command lie side by side, so that one FC16 starts a move and the device never moves to a half-written
target.
""",
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


# --- sample changer ------------------------------------------------------------------------------------

PLACES = 8  # [A]
TRAVEL = 0.1  # m, travel of the carriage for any exchange [A]
NAME = 64  # bytes of a sample's name
FIRST_PLACE, REGISTERS_OF_PLACE = 0x60, NAME // 2


def _name(name: str, address: int, meaning: str, access: Access = "ro") -> Field:
    return Field(name, address, "text", meaning, access=access, default="", length=NAME)


SAMPLE_CHANGER = Contract(
    name="sample_changer",
    title="sample changer",
    bus="modbus",
    identity=Identity("Palpate", "SC-1", "1.0"),
    about="""\
Sample changer, Modbus TCP. Our own map, after laboratory autosamplers.

A sample is ordered by its name. A tag reader tells the name of what lies under the probe, whoever laid it there.
""",
    fields=(
        probe(0x00),
        Field("speed", 0x02, "uint16", "speed of the carriage", "m/s", 1e-3, "rw", 1e-3, 0.2, 0.02),
        _name("order", 0x10, "write a sample's name to have it laid under the probe; refused where no place holds it "
              "(3), while the probe is down (4), while the changer moves (6)", "wo"),
        _name("mounted", 0x30, "name on the tag of what lies under the probe; empty: no tag is there"),
        Field("exchanges", 0x50, "uint32", "how often that has changed, by an order or by hand; kept without power"),
        Field("status", 0x52, "uint16", "status word", bits={"moving": 0, "probe_down": 1}),
        *(
            _name(f"place_{number}", FIRST_PLACE + REGISTERS_OF_PLACE * (number - 1),
                  f"name of the sample that belongs into place {number}; empty: none")
            for number in range(1, PLACES + 1)
        ),
    ),
)  # fmt: skip


# --- sensor node ---------------------------------------------------------------------------------------

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


SENSOR_NODE = Contract(
    name="sensor_node",
    title="sensor node",
    bus="canopen",
    identity=Identity("0x50414C50", "0x534E0001", "0x00010000"),
    about="""\
Sensor array node, CANopen. Communication objects by CiA 301, channel objects after CiA 404 measuring
devices (Baumer: 6131 unit, 6132 digits, 7130 INT16 process value); 2000h to 2110h are our own.

A node samples its four channels at each SYNC and sends them in TPDO 1, then the sample's number and the
saturation flags in TPDO 2. The node that is SYNC producer (bit 30 of 1005h) sets the sample rate by its
cycle period (1006h).
""",
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
        nodes * [sum(SENSOR_NODE[name].size for name in pdo.fields) for pdo in SENSOR_NODE.pdos], rate, bitrate
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
