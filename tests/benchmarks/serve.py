"""What serving costs: the bench's Modbus server beside a bare one of pymodbus, and a sweep from another process."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from palpate.instrument.bench.links import LOOPBACK
from palpate.instrument.contracts.own import SIGNAL_GENERATOR
from palpate.procedures.virtual.served_bench import Wish, serving
from palpate.simulators.bench import BenchAddresses
from palpate.simulators.planning.settle import read_scene
from tests.benchmarks.in_turn import beside, served
from tests.benchmarks.row import Row

REQUESTS = 3000  # of a round, all clients together
ROUNDS = 5
GOAL = 0.8
CLIENTS = (1, 8, 32)
COST = 10e-6  # s
SERVED = """
from palpate.procedures.virtual.served_bench import Wish, serving
from palpate.simulators.bench import BenchAddresses
from palpate.simulators.planning.settle import read_scene
with serving(Wish(read_scene("thesis_single"), BenchAddresses(), None, 1.0, 1.0, (), None)) as served:
    print(json.dumps({"port": served.description.links["signal_generator"].port}), flush=True)
    for _ in sys.stdin:
        print(json.dumps(used()), flush=True)
"""
SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.5 s", "--json")
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
NOTHING = Wish(read_scene("thesis_single"), BenchAddresses(), None, 1.0, 1.0, (), None)


def measure() -> Iterator[Row]:
    """Processor time of a request, requests a second, and the ratio of a sample from another process."""
    for clients in CLIENTS:
        costs = served(SERVED, partial(cost, clients=clients), ROUNDS)
        yield Row(
            f"a served request, {clients} client{'s' * (clients > 1)}: processor time",
            beside([1e6 * each for each in costs], "{:.1f} µs".format), f"<= {1e6 * COST:.0f} µs", costs[0] <= COST,
        )  # fmt: skip
    with TemporaryDirectory() as folder:
        yield _peer("pyModbusTCP", PYMODBUSTCP)
        yield _peer("libmodbus", _built(LIBMODBUS, Path(folder) / "server"))
    with serving(NOTHING) as bench, _bare() as bare:
        for clients in (1, 8):
            own_rate, bare_rate = _rates(bench.description.links["signal_generator"].port, bare, clients)
            ratio = own_rate / bare_rate
            yield Row(
                f"served generator / bare pymodbus, {clients} client{'s' * (clients > 1)}",
                f"{own_rate:.0f} / {bare_rate:.0f} requests/s = {ratio:.2f}",
                f">= {GOAL}",
                ratio >= GOAL,
            )
    yield _other_process()


def _peer(name: str, script: str | None) -> Row:
    """Processor time of a request to another server."""
    figure = f"the same of {name}'s server, {' / '.join(map(str, CLIENTS))} clients"
    if script is None:
        return Row(figure, "not tried: it needs a C compiler and libmodbus (Debian: gcc, libmodbus-dev)")
    costs = [served(script, partial(cost, clients=clients), ROUNDS)[0] for clients in CLIENTS]
    return Row(figure, " / ".join(f"{1e6 * each:.1f}" for each in costs) + " µs")


def _built(source: Path, program: Path) -> str | None:
    """A script that becomes the program of a C source; None where it cannot be built."""
    command = ["cc", "-O2", str(source), "-o", str(program), "-lmodbus"]
    if shutil.which(command[0]) is None or subprocess.run(command, check=False, stderr=subprocess.DEVNULL).returncode:
        return None
    return f"os.execv({str(program)!r}, [{str(program)!r}])"


def cost(ready: dict[str, Any], used: Callable[[], dict[str, float]], clients: int) -> float:
    """Processor time of the server for a request [s]."""
    before = used()
    _ask(ready["port"], clients)
    return (used()["cpu"] - before["cpu"]) / (clients * (REQUESTS // clients))


def _rates(own: int, bare: int, clients: int) -> tuple[float, float]:
    """Best of some rounds, taken in turn."""
    context = get_context("spawn")
    with context.Pool(1) as pool:  # a client of its own process, as real ones are
        taken = [[pool.apply(_ask, (port, clients)) for port in (own, bare)] for _ in range(ROUNDS)]
    return max(rates[0] for rates in taken), max(rates[1] for rates in taken)


def _ask(port: int, clients: int) -> float:
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

    async def all_clients() -> float:
        loop = asyncio.get_running_loop()
        start = loop.time()
        await asyncio.gather(*(client(number) for number in range(clients)))
        return clients * (REQUESTS // clients) / (loop.time() - start)

    return asyncio.run(all_clients())


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


def _other_process() -> Row:
    """A point that one process takes on the bench that another serves, by the wall, beside one of its own bench."""
    palpate = (sys.executable, "-c", "from palpate.procedures.commands import main; main()")
    with TemporaryDirectory() as folder:
        bench = Path(folder) / "bench.toml"
        environment = {**os.environ, "PALPATE_STORE": folder}
        command = [*palpate, "serve", "thesis_single", "--samples", "1", "--out", str(bench), "--json"]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            while server.stdout.readline() != "}\n":  # the bench is there
                pass

            def sample(*more: str) -> dict[str, float]:
                done = subprocess.run(
                    [*palpate, *SWEEP, *more],
                    stdin=subprocess.DEVNULL,
                    capture_output=True,
                    text=True,
                    check=True,
                    env=environment,
                )
                found: dict[str, float] = json.loads(done.stdout)["samples"][0]
                return found

            try:
                served, own = sample("--bench", str(bench)), sample()
            finally:
                server.communicate("quit\n")
    apart = abs(served["force_ratio"] - own["force_ratio"])
    u = (served["force_ratio_u"] ** 2 + own["force_ratio_u"] ** 2) ** 0.5
    return Row(
        "sample 1 from another process / own bench",
        f"{served['force_ratio']:.4f} / {own['force_ratio']:.4f}, {apart / u:.1f} u apart",
        "<= 2 u",
        apart <= 2 * u and server.returncode == 0,
    )
