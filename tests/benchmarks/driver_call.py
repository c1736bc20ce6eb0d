"""What a driver adds to the bare library call, on the same simulated device in one run."""

from __future__ import annotations

from collections.abc import Iterator

from pymodbus.client import ModbusSerialClient, ModbusTcpClient

from palpate.drivers.bench import Bench
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from tests.benchmarks.row import Row, interleaved

ROUNDS = 1500
RTU_ROUNDS = 300
GOAL = 1.25


def measure() -> Iterator[Row]:
    with SimulatedBench(read_scene("thesis_single")) as sim:
        d = sim.description
        address = d.links["signal_generator"]
        raw = ModbusTcpClient(address.host, port=address.port, retries=0)
        raw.connect()
        with Bench(d, sim.clock, sim.operator) as bench:
            generator, node = bench.device("signal_generator"), bench.device("sensor_node_1")
            yield _row(
                "generator read (Modbus TCP), driver / pymodbus",
                *interleaved(
                    lambda: generator.get_many("frequency", "amplitude", "offset"),
                    lambda: raw.read_holding_registers(0x10, count=6, device_id=1),
                    ROUNDS,
                ),
            )
            yield _row(
                "generator write (Modbus TCP), driver / pymodbus",
                *interleaved(
                    lambda: generator.set(frequency=10.0, amplitude=0.5),
                    lambda: raw.write_registers(0x10, [0, 10_000, 7, 41_248], device_id=1),
                    ROUNDS,
                ),
            )
            remote = node.link.add_node(node.id)
            yield _row(
                "node read (CANopen SDO), driver / canopen",
                *interleaved(lambda: node.get("sync_period"), lambda: remote.sdo.upload(0x1006, 0), ROUNDS),
            )
            driver_time, _ = interleaved(
                bench.device("strain_indicator").read, bench.device("strain_indicator").read, RTU_ROUNDS
            )
        raw.close()
        # a serial port has one owner: the bare client has its turn when the driver has closed it
        serial = ModbusSerialClient(d.links["line"].port, baudrate=d.links["line"].baudrate, retries=0)
        serial.connect()
        raw_time, _ = interleaved(
            lambda: serial.read_holding_registers(0x20, count=6, device_id=1), lambda: None, RTU_ROUNDS
        )
        serial.close()
        yield _row("indicator read (Modbus RTU), driver / pymodbus", driver_time, raw_time)


def _row(figure: str, driver: float, bare: float) -> Row:
    ratio = driver / bare
    return Row(figure, f"{1e6 * driver:.0f} / {1e6 * bare:.0f} us = {ratio:.2f}", f"<= {GOAL}", ratio <= GOAL)
