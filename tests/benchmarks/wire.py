"""What the wire costs: drivers, served benches, many nodes, busy machines, replies that come twice."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import shutil
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from palpate.drivers.bench import Bench
from palpate.drivers.devices.sensor_node import CanopenSensorNode, acquire
from palpate.instrument.bench.links import LOOPBACK
from palpate.instrument.contracts.own import SIGNAL_GENERATOR
from palpate.procedures.testing.benches import simulated_bench
from palpate.procedures.virtual.served_bench import Wish, serving
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from palpate.simulators.planning.settle import read_scene
from tests.benchmarks.common import (
    Campaign,
    Row,
    at_least,
    at_most,
    beside,
    in_turn,
    in_turn_while_running,
    interleaved,
    none,
    opened,
    palpate,
    pressed,
    served,
    spent,
    version_of,
)
from tests.conftest import open_ends
from tests.drivers.test_stale import NONE, TOLD, tried

# --- drivers -------------------------------------------------------------------------------------------


def driver_call(rounds: int = 1500) -> Iterator[Row]:
    """What a driver adds to the bare library call, on the same simulated device in one run."""
    with SimulatedBench(read_scene("thesis_single")) as sim:
        address, line = (sim.description.links[name] for name in ("signal_generator", "line"))
        raw = ModbusTcpClient(address.host, port=address.port, retries=0)
        raw.connect()
        with Bench(sim.description, sim.clock, sim.operator) as bench:
            generator, node, indicator = map(bench.device, ("signal_generator", "sensor_node_1", "strain_indicator"))
            remote = node.link.add_node(node.id)
            calls: dict[str, tuple[Callable[[], object], Callable[[], object]]] = {
                "generator read (Modbus TCP), driver / pymodbus": (
                    lambda: generator.get_many("frequency", "amplitude", "offset"),
                    lambda: raw.read_holding_registers(0x10, count=6, device_id=1),
                ),
                "generator write (Modbus TCP), driver / pymodbus": (
                    lambda: generator.set(frequency=10.0, amplitude=0.5),
                    lambda: raw.write_registers(0x10, [0, 10_000, 7, 41_248], device_id=1),
                ),
                "node read (CANopen SDO), driver / canopen": (
                    lambda: node.get("sync_period"),
                    lambda: remote.sdo.upload(0x1006, 0),
                ),
            }
            times = {figure: interleaved(*both, rounds) for figure, both in calls.items()}
            own, _ = interleaved(indicator.read, int, rounds // 5)
        raw.close()
        # a serial port has one owner: the bare client has its turn when the driver has closed it
        serial = ModbusSerialClient(line.port, baudrate=line.baudrate, retries=0)
        serial.connect()
        bare, _ = interleaved(lambda: serial.read_holding_registers(0x20, count=6, device_id=1), int, rounds // 5)
        serial.close()
    for figure, (driver, library) in {**times, "indicator read (Modbus RTU), driver / pymodbus": (own, bare)}.items():
        ratio = driver / library
        yield at_most(figure, ratio, 1.25, "{:.2f}", f"{1e6 * driver:.0f} / {1e6 * library:.0f} us = {ratio:.2f}")


def array(seconds: float = 60.0) -> Iterator[Row]:
    """Twenty nodes, two films each, 1 kHz, for a minute of bench time."""
    nodes, rate = 20, 1000
    with opened(replace(read_scene("thesis_single"), nodes=nodes)) as (_, bench):
        pressed(bench)
        recordings: list[Any] = []
        # it raises where a counter is not continuous
        wall = spent(lambda: recordings.extend(acquire(bench.all(CanopenSensorNode), seconds))).wall
    lost = nodes * round(rate * seconds) - sum(each.time.size for each in recordings)
    what = f"{nodes} nodes at {rate} Hz for {seconds:.0f} s"
    yield none(f"{what}: samples lost", lost)
    frames = (2 * nodes + 1) * round(rate * seconds)
    yield at_most(f"{what}: wall time", wall, seconds, "{:.0f} s", f"{wall:.1f} s, {frames / wall:.0f} frames/s")


# --- served benches ------------------------------------------------------------------------------------

REQUESTS = 3000  # of a round, all clients together
CLIENTS = (1, 8, 32)
SERVED = """
from palpate.procedures.virtual.served_bench import Wish, serving
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from palpate.simulators.planning.settle import read_scene
with serving(Wish(read_scene("thesis_single"), BenchAddresses(), None, 1.0, 1.0, (), None)) as served:
    print(json.dumps({"port": served.description.links["signal_generator"].port}), flush=True)
    for _ in sys.stdin:
        print(json.dumps(used()), flush=True)
"""
PYMODBUSTCP = """
from pyModbusTCP.server import ModbusServer
server = ModbusServer("127.0.0.1", 0, no_block=True)
server.start()
print(json.dumps({"port": server._service.server_address[1]}), flush=True)
for _ in sys.stdin:
    print(json.dumps(used()), flush=True)
server.stop()
"""
LIBMODBUS = Path(__file__).with_name("libmodbus_server.c")


def serve(rounds: int = 5) -> Iterator[Row]:
    """What serving costs: the bench's Modbus server beside a bare one of pymodbus, and a sweep from another process."""
    for clients in CLIENTS:
        costs = [1e6 * each for each in in_turn_while_running(SERVED, partial(cost, clients=clients), rounds)]
        yield at_most(
            f"a served request, {clients} client{'s' * (clients > 1)}: processor time",
            costs[0],
            10,
            "{:.0f} µs",
            beside(costs, "{:.1f} µs".format),
        )
    with TemporaryDirectory() as folder:
        for name, script in (("pyModbusTCP", PYMODBUSTCP), ("libmodbus", _built(Path(folder) / "server"))):
            told = "not tried: it needs a C compiler and libmodbus (Debian: gcc, libmodbus-dev)"
            if script is not None:
                of = [in_turn_while_running(script, partial(cost, clients=clients), rounds)[0] for clients in CLIENTS]
                told = " / ".join(f"{1e6 * each:.1f}" for each in of) + " µs"
            yield Row(f"the same of {name}'s server, {' / '.join(map(str, CLIENTS))} clients", told)
    wish = Wish(read_scene("thesis_single"), BenchAddresses(), None, 1.0, 1.0, (), None)
    with (
        serving(wish) as bench,
        _bare() as bare,
        get_context("spawn").Pool(1) as pool,
    ):  # clients of a process of its own
        ports = bench.description.links["signal_generator"].port, bare
        for clients in CLIENTS[:2]:
            taken = [[pool.apply(_rate, (port, clients)) for port in ports] for _ in range(rounds)]
            own, other = map(max, zip(*taken, strict=True))
            yield at_least(
                f"served generator / bare pymodbus, {clients} client{'s' * (clients > 1)}",
                own / other,
                0.8,
                "{:.2f}",
                f"{own:.0f} / {other:.0f} requests/s = {own / other:.2f}",
            )
    yield _from_another_process()


def _built(program: Path) -> str | None:
    """A script that becomes the program of a C source; None where it cannot be built."""
    command = ["cc", "-O2", str(LIBMODBUS), "-o", str(program), "-lmodbus"]
    if shutil.which(command[0]) is None or subprocess.run(command, check=False, stderr=subprocess.DEVNULL).returncode:
        return None
    return f"os.execv({str(program)!r}, [{str(program)!r}])"


def cost(ready: dict[str, Any], used: Callable[[], dict[str, float]], clients: int) -> float:
    """Processor time of the server for a request [s]."""
    before = used()
    _rate(ready["port"], clients)
    return (used()["cpu"] - before["cpu"]) / (clients * (REQUESTS // clients))


def _rate(port: int, clients: int) -> float:
    """Requests a second of so many clients, each of which waits for its answer; checks that it is the right one."""
    address, count = SIGNAL_GENERATOR.block(["frequency", "amplitude"])
    body = bytes([1, 3]) + address.to_bytes(2) + count.to_bytes(2)

    async def client(number: int) -> None:
        reader, writer = await asyncio.open_connection(LOOPBACK, port)
        for i in range(REQUESTS // clients):
            transaction = (number * REQUESTS + i) % 65536
            writer.write(transaction.to_bytes(2) + bytes(2) + len(body).to_bytes(2) + body)
            reply = await reader.readexactly(9 + 2 * count)
            assert int.from_bytes(reply[:2]) == transaction
            assert reply[7:9] == bytes([3, 2 * count])
        writer.close()

    async def all_clients() -> None:
        await asyncio.gather(*(client(number) for number in range(clients)))

    return clients * (REQUESTS // clients) / spent(lambda: asyncio.run(all_clients())).wall


@contextmanager
def _bare() -> Iterator[int]:
    """A server of pymodbus with the same registers and nothing behind them; its port."""
    registers = [SimData(f.address, count=f.size // 2, datatype=DataType.REGISTERS) for f in SIGNAL_GENERATOR.fields]
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    async def start() -> ModbusTcpServer:
        server = ModbusTcpServer([SimDevice(id=1, simdata=registers)], address=(LOOPBACK, 0))
        await server.serve_forever(background=True)
        return server

    server = asyncio.run_coroutine_threadsafe(start(), loop).result()
    yield server.transport.sockets[0].getsockname()[1]
    asyncio.run_coroutine_threadsafe(server.shutdown(), loop).result()
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


def _from_another_process() -> Row:
    """A point that one process takes on the bench that another serves, by the wall, beside one of its own bench."""
    with TemporaryDirectory() as folder, served(Path(folder)) as bench:
        sweep = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.5 s", "--json")
        told = [palpate(*sweep, *more) for more in (("--bench", str(bench)), ())]
    other, own = (json.loads(each)["samples"][0] for each in told)
    apart = (
        abs(other["force_ratio"] - own["force_ratio"])
        / (other["force_ratio_u"] ** 2 + own["force_ratio_u"] ** 2) ** 0.5
    )
    return at_most(
        "sample 1 from another process / own bench",
        apart,
        2,
        "{:g} u",
        f"{other['force_ratio']:.4f} / {own['force_ratio']:.4f}, {apart:.1f} u apart",
    )


# --- busy machines -------------------------------------------------------------------------------------

# It ends with the process that started it, and in an hour whatever became of that.
SPIN = """
import os, time
parent, end = os.getppid(), time.monotonic() + 3600
while os.getppid() == parent and time.monotonic() < end:
    for _ in range(1_000_000):
        pass
"""


@contextmanager
def busy(count: int) -> Iterator[None]:
    """So many other programs want the processor."""
    programs = [subprocess.Popen([sys.executable, "-S", "-E", "-c", SPIN]) for _ in range(count)]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()


def load(sweeps: int = 20, programs: int = 40, at_once: int = 4) -> Iterator[Row]:
    """Sweeps on served benches while others want the processor: does the watchdog trip on a living one?"""
    with TemporaryDirectory() as place, busy(programs), ThreadPoolExecutor(at_once) as pool:
        failures = [said for said in pool.map(_swept, (Path(place) / str(number) for number in range(sweeps))) if said]
        others = os.getloadavg()[0]
    figure = f"served sweeps that end well, {at_once} at once beside {programs} busy programs, load {others:.0f}"
    well = sweeps - len(failures)
    yield Row(figure, f"{well} of {sweeps}" + "".join(f": {each}" for each in failures[:1]), "all", well == sweeps)


def _swept(folder: Path) -> str:
    """What one sweep said where it failed."""
    folder.mkdir()
    sweep = ("sweep", "loads", "--samples", "1", "--loads", "2 N, 3 N", "--quiet", "--out", folder / "run")
    with served(folder) as bench:
        try:
            palpate(*sweep, "--bench", bench, stdin=None, input="\n")
        except subprocess.CalledProcessError as error:
            return error.stderr.strip() or "failed"
    return ""


# --- replies that come twice ---------------------------------------------------------------------------


def stale(goal: int = 1_000_000, block: int = 10_000) -> Iterator[Row]:
    """Replies that come again up to two time-outs later, on wires that do not number their frames.

    Resumable: each ten thousand goes into the campaign.
    """
    for library in ("pymodbus", "pymodbus.logging", "canopen"):
        logging.getLogger(library).setLevel(logging.CRITICAL)  # of each reply that does not come
    campaign = Campaign(
        "stale", version_of("drivers/**/*.py", "tests/drivers/test_stale.py", "tests/drivers/fake_links.py")
    )
    done = campaign.go_on(tried(number, block) for number in range(len(campaign.found), -(-goal // block)))
    found = sum(map(Counter, done), Counter[str]())
    tries = sum(count for what, count in found.items() if what.endswith(": tries"))
    yield at_least("replies that come twice, up to two time-outs apart, tries", tries, goal, "{}")
    for what in (*NONE, *TOLD):
        kind = what.partition(":")[0]
        of = found[f"{ {'lengths alike': 'lengths differ', 'polls alike': 'polls'}.get(kind, kind) }: tries"]
        said = f"{found[what]} of {of} = {found[what] / of:.2%}"
        yield none(f"  {what}", found[what], said) if what in NONE else Row(f"  {what}", said)


# --- fixtures ------------------------------------------------------------------------------------------

OPENED = """
import statistics
from palpate.procedures.testing.benches import simulated_bench
from palpate.simulators.planning.settle import read_scene
scene, taken = read_scene({scene!r}), []
for _ in range(25):
    before = used()
    with simulated_bench(scene) as watch, watch.bench:
        pass
    taken.append(spent(before))
print(json.dumps({{name: statistics.median(each[name] for each in taken) for name in ("cpu", "wall")}}))
"""


def fixture() -> Iterator[Row]:
    """What a bench of its own costs a test: the plugin's, as the fixture `bench` opens and closes it."""
    for name in ("thesis_single", "noisy_lab"):
        found = in_turn(OPENED.format(scene=name), rounds=3)
        walls, cpus = ([1e3 * each[what] for each in found] for what in ("wall", "cpu"))
        yield at_most(
            f"bench fixture, {name}: up and down",
            walls[0],
            10,
            "{:.0f} ms",
            f"{beside(walls, '{:.1f} ms'.format)} (processor {beside(cpus, '{:.1f} ms'.format)})",
        )
        before = open_ends()
        with simulated_bench(read_scene(name)) as watch, watch.bench:
            pass
        yield none(f"bench fixture, {name}: threads, sockets, ptys left", len(open_ends() - before))
