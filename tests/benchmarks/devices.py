"""Devices that can be bought and their makers' files, and what tools that are none of ours find wrong."""

from __future__ import annotations

import itertools
import json
import math
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import can

from palpate.drivers.bench import Bench
from palpate.drivers.clock import WallClock
from palpate.drivers.links.modbus import read_registers
from palpate.drivers.logs.bus_log import BusLog, Link, read_pcapng
from palpate.instrument.bench.kinds import kind_of
from palpate.instrument.bench.links import MULTICAST, keep_to_group
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import Field
from palpate.instrument.contracts.maps.eds import FOLDERS, folders
from palpate.instrument.contracts.maps.golden_frames import prove
from palpate.instrument.contracts.maps.map_file import SHIPPED, read_map
from palpate.instrument.contracts.own import SENSOR_NODE
from palpate.instrument.errors import BenchError
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.measurements.loads import LoadPoint, LoadSweep
from palpate.procedures.virtual.served_bench import Served, Wish, serving
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire.device import SimulatedDevice
from tests.benchmarks.common import Row, at_least, at_most, measured, none, opened, spent
from tests.second_reader import hold

# --- real bench ----------------------------------------------------------------------------------------

COUNT = 0.5 / 32768  # V, of either node
SETTINGS = {  # of the kinds that have them
    "full_scale": 0.5, "metres_per_step": 1e-6, "span": 10.306, "travel": "25 mm", "volts_per_unit": COUNT,
}  # fmt: skip


def real_bench() -> Iterator[Row]:
    """The bench of twins of devices that can be bought: what it measures beside ours, and how soon a map is in use."""
    usual, devices = read_scene("thesis_single"), read_scene("real_bench").devices
    # effects that neither scatter nor are noise
    quiet = replace(usual, effects={name: usual.effects[name] for name in ("charge_amplifier", "adc")})
    pairs = _pairs(quiet, devices)
    apart = max(abs(a.force_ratio / b.force_ratio - 1) * a.voltage_rigid_V / COUNT for a, b in pairs)
    yield at_most(
        f"real_bench: {len(pairs)} force ratios without scatter and noise, apart from ours at most",
        apart,
        1,
        "{:.2f} counts of a node",
    )
    pairs = _pairs(usual, devices)
    far = sum(abs(a.force_ratio - b.force_ratio) > 2 * math.hypot(a.force_ratio_u, b.force_ratio_u) for a, b in pairs)
    yield none(f"real_bench: of {len(pairs)} force ratios with noise, beyond 2 uncertainties of ours", far)
    taken = {file.stem: spent(lambda file=file: used(file)).cpu for file in sorted(SHIPPED.glob("*.toml"))}
    slowest = max(taken, key=taken.__getitem__)
    yield at_most(
        f"{len(taken)} shipped maps: read, proved and a twin of it made, slowest ({slowest}), processor time",
        taken[slowest],
        5,
        "{:.2f} s",
    )


def _pairs(scene: Scene, devices: object) -> list[tuple[LoadPoint, LoadPoint]]:
    """The points of a sweep on the devices of a scene, and on others."""
    asked, points = LoadSweep(tuple("123456"), (2.0, 3.0), 1.0, 10.0), []
    for each in (scene, replace(scene, devices=devices)):
        with TemporaryDirectory() as folder, opened(each) as (_, bench):
            points.append(measured(asked, bench, get_design("single"), Path(folder) / "run").points)
    return list(zip(*points, strict=True))


def used(file: Path) -> None:
    """A map is read and proved, and a bench on which its twin stands is served and closed."""
    found = read_map(file)
    assert not prove(found.contract, found.frames).problems
    kind = kind_of(found)
    settings = {key: value for key, value in SETTINGS.items() if key in kind.settings.model_fields}
    section = {"kind": kind.name, "role": kind.roles[0], **settings}
    with SimulatedBench(read_scene("ideal").with_devices({"twin": section})):
        pass


def eds() -> Iterator[Row]:
    """Makers' EDS and DCF files, of folders that PALPATE_EDS names, held against a second reader of CiA 306.

    The files belong to their makers, and are in no repository.
    """
    files = [
        path for folder in folders() for path in sorted(folder.iterdir()) if path.suffix.lower() in (".eds", ".dcf")
    ]
    held = [hold(path) for path in files]
    objects, pdos = sum(each.objects for each in held), sum(each.pdos for each in held)
    yield at_least(
        "makers' EDS and DCF",
        len(files),
        100,
        "{} files",
        f"{len(files)}, {objects} objects, {pdos} PDOs" if files else f"{FOLDERS} names no folder with any",
    )
    for what, name in (("wrong", "wrong"), ("lost without a note", "lost"), ("refused wrongly", "refused")):
        faults = [fault for each in held for fault in getattr(each, name)]
        yield none(f"of these, {what}", len(faults), "; ".join([str(len(faults)), *faults[:5]]))


# --- masters -------------------------------------------------------------------------------------------

NODE = 1
MASTER = Path(__file__).with_name("canopen_master.js")
DISSECTORS = ("-d", "can.subdissector,canopen", "-d", "rtacser.data,mbrtu", "-o", "mbrtu.crc_verification:TRUE")
NOTE = 0x400000  # of an expert of Wireshark: warnings and errors are above, comments below
LONG = ("4:int", "-B")
TYPES = {"uint16": ("4",), "int16": ("4",), "uint32": LONG, "int32": LONG, "float32": ("4:float", "-B")}
REFUSED = [0x06020000, 0x06090011, 0x06010002, 0x06090030, 0x06070010]  # as the script asks for them (CiA 301)
TIMED_OUT = 0x05040000
SENSITIVE = "01"
STATES = {0, 4, 5, 127}  # of heartbeats: boot-up, stopped, operational, pre-operational


def masters() -> Iterator[Row]:
    """What tools that are none of ours find wrong on the served bench: complaints of masters and dissectors.

    Needs `mbpoll` and `tshark` (Debian packages), and node with npm's `canopen`, which NODE_PATH may have to name. One
    that is missing is said and not tried.
    """
    wish = Wish(read_scene("thesis_single"), BenchAddresses(interface=MULTICAST), None, 1.0, None, (), None)
    with serving(wish) as served:
        yield _told("mbpoll", ["mbpoll"], lambda: _mbpoll(served.sim))
        yield _told("canopen of npm", ["node", "-e", "require('canopen')"], lambda: _canopen(served))
        yield _told("tshark", ["tshark"], lambda: _tshark(served))


def _told(tool: str, needs: list[str], ask: Callable[[], tuple[str, list[str]]]) -> Row:
    """`ask` says what was tried, and the complaints."""
    figure = f"complaints of {tool}"
    if shutil.which(needs[0]) is None or (needs[1:] and subprocess.run(needs, capture_output=True).returncode):
        return Row(figure, "not tried: it is not installed", "0")
    tried, complaints = ask()
    return none(figure, len(complaints), "\n".join([f"{len(complaints)} in {tried}", *complaints]))


# --- mbpoll --------------------------------------------------------------------------------------------


def _mbpoll(sim: SimulatedBench) -> tuple[str, list[str]]:
    generator, amplifier = sim.description.links["signal_generator"], sim.description.links["shaker_amplifier"]
    line = (sim.description.links["line"].port, "-m", "rtu", "-b", "115200", "-P", "none")
    own = (generator.host, "-p", str(generator.port))
    ends: list[tuple[SimulatedDevice, tuple[str, ...]]] = [
        (sim.generator, own),
        (sim.amplifier, (amplifier.host, "-p", str(amplifier.port))),
        (sim.indicator, (*line, "-a", "1")),
        (sim.positioner, (*line, "-a", "2")),
    ]
    complaints, tried = [], 0
    for device, end in ends:
        for field in device.contract.fields:
            if field.access != "wo":
                tried += 1
                with sim.clock.lock:
                    before = _number(device.contract, field, device.read(field.name))
                said = _poll(*end, "-r", str(field.address), "-t", *TYPES[field.type])
                with sim.clock.lock:
                    after = _number(device.contract, field, device.read(field.name))
                if not any(f"]: \t{each}" in said for each in (before, after)):  # some of them go on meanwhile
                    complaints.append(f"{device.contract.name} {field.name} is {before}: {said}")
    settings = {"frequency": ("4:int", "-B"), "output": ("4",), "offset": ("4:int", "-B")}
    for (name, kind), value in zip(settings.items(), (12_500, 1, -5000), strict=True):
        tried += 1
        field = sim.generator.contract[name]
        said = _poll(*own, "-r", str(field.address), "-t", *kind, "--", str(value))
        if "Written 1" not in said or round(sim.generator.settings[name] / field.scale) != value:
            complaints.append(f"write of {name} = {value}: {said}")
    for what, options in {
        "Illegal data address": ("-r", "28672"),
        "Illegal function": ("-t", "3"),
        "Illegal data value": ("-r", "18", "-t", "4:int", "-B", "--", "2000000000"),
        "Target device failed to respond": ("-a", "9"),
    }.items():
        tried += 1
        if what not in (said := _poll(*own, *options)):
            complaints.append(f"{what} belongs here: {said}")
    tried += 1
    if "timed out" not in (said := _poll(*line, "-a", "9", "-o", "0.3")):
        complaints.append(f"no answer of unit 9 belongs here: {said}")
    return f"{tried} transactions", complaints


def _poll(*arguments: str) -> str:
    """What mbpoll says; options may stand behind the device."""
    done = subprocess.run(["mbpoll", "-0", "-1", *arguments], capture_output=True, text=True, timeout=10)
    found = re.findall(r"^(?:\[\d+\]: .*|Written.*|.*failed:.*)$", done.stdout + done.stderr, re.MULTILINE)
    return "; ".join(found) or "nothing"


def _number(contract: Contract, field: Field, value: float) -> str:
    if field.type == "float32":
        return f"{value:g}"
    return str(int.from_bytes(contract.pack(field.name, value), "big", signed=field.type == "int32"))


# --- a CANopen master that is not canopen of Python ----------------------------------------------------


def _canopen(served: Served) -> tuple[str, list[str]]:
    node = served.sim.nodes[0]
    fields = {f.name: f for f in SENSOR_NODE.fields if f.access != "wo"}
    asked = json.dumps([[f.index, f.subindex, name] for name, f in fields.items()])
    with (
        can.Bus(interface=MULTICAST, channel=served.description.links["can"].channel, hop_limit=0) as bus,
        subprocess.Popen(
            ["node", str(MASTER), str(NODE), asked], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as master,
    ):
        keep_to_group(bus)
        assert master.stdin is not None
        assert master.stdout is not None
        held = {name: _raw(field, node.read(field)) for name, field in fields.items()}
        said = master.stdin

        def hear(message: can.Message) -> None:
            if message.arbitration_id not in own:
                said.write(f"{message.arbitration_id:x} {message.data.hex()}\n")
                said.flush()

        own = {0x000, 0x600 + NODE, 0x77E}  # what the master itself sends comes back on multicast
        with can.Notifier(bus, [hear], timeout=0.1):
            for line in master.stdout:
                if line.startswith("="):
                    return _judged(json.loads(line[1:]), held)
                identifier, data = line.split(" ")
                bus.send(
                    can.Message(
                        arbitration_id=int(identifier, 16), data=bytes.fromhex(data.strip()), is_extended_id=False
                    )
                )
    return "no transfer", ["it has ended early"]


def _raw(field: Field, value: Any) -> str:
    if field.type == "text":
        return str(value).encode().hex()
    return int(value).to_bytes(field.size, "little", signed=value < 0).hex()


def _judged(seen: dict[str, Any], held: dict[str, str]) -> tuple[str, list[str]]:
    complaints = [str(seen["error"])] if "error" in seen else []
    for name, right in held.items():
        if seen["objects"].get(name) != right:
            complaints.append(f"{name} is {right}: {seen['objects'].get(name)}")
    for what, right in {"refusals": REFUSED, "range": SENSITIVE, "stopped": TIMED_OUT, "reset": "00"}.items():
        if seen.get(what) != right:
            complaints.append(f"{what}: {right} belongs here: {seen.get(what)}")
    if set(seen["beats"]) != STATES:
        complaints.append(f"states of its heartbeats are {seen['beats']}")
    samples, numbers = seen["pdos"]["384"], [number for number, _ in seen["pdos"]["640"]]
    # of samples it tells only where they are others than before
    if not 0 < len(samples) <= len(numbers) or numbers != list(range(1, len(numbers) + 1)):
        gaps = [number for last, number in itertools.pairwise(numbers) if number != last + 1]
        complaints.append(f"{len(samples)} samples, {len(numbers)} from {numbers[:1]} on; gaps before {gaps[:9]}")
    return f"{len(held) + len(REFUSED) + 8} transfers, {len(samples)} samples", complaints


# --- dissectors ----------------------------------------------------------------------------------------


def _tshark(served: Served) -> tuple[str, list[str]]:
    """What tshark says of the log of a bench that is opened, moved, sampled and refuses something."""
    with TemporaryDirectory() as folder:
        log = Path(folder) / "trace.blf"
        clock = WallClock()
        bench = Bench(served.description, clock, served.sim.operator)
        with BusLog(bench, clock, log, datetime.now(UTC)), bench:
            bench.device("positioner").move(1e-3)
            bench.device("strain_indicator").read()
            bench.device("sensor_node_1").acquire(0.2)
            with suppress(BenchError):
                bench.device("shaker_amplifier").link.transact("it", read_registers, 0x7000, 1, 1)
        whole = log.with_suffix(".pcapng")
        packets = [packet for packet in read_pcapng(whole) if packet.link is not Link.NOTE]
        complaints = []
        for file, count in ((whole, len(packets)), (log, sum(packet.link is Link.CAN for packet in packets))):
            wrong = f"_ws.malformed || _ws.short || _ws.expert.severity >= {NOTE}"
            complaints += [f"{file.name}: {line}" for line in _dissected(file, "-Y", wrong)]
            understood = len(_dissected(file, "-Y", "modbus || canopen"))
            if understood != count:
                complaints.append(f"{file.name}: {count - understood} of {count} messages are not understood")
    return f"{len(packets)} messages", complaints


def _dissected(file: Path, *options: str) -> list[str]:
    done = subprocess.run(
        ["tshark", "-r", str(file), *DISSECTORS, *options], capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()
