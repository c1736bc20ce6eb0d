"""A simulated bench under test: opened, driven, looked at behind the bus."""

from __future__ import annotations

from palpate.drivers.bench import Bench
from palpate.instrument.bench.description import BenchDescription
from palpate.simulators.bench import SimulatedBench


def open_bench(sim: SimulatedBench, description: BenchDescription | None = None) -> Bench:
    return Bench(description or sim.description, sim.clock, sim.operator)


def driving(sim: SimulatedBench) -> bool:
    """Whether any of the three means of switching off is not used."""
    generator, amplifier = sim.generator.settings, sim.amplifier.settings
    return bool(generator["amplitude"] or generator["output"] or amplifier["enable"])


def drive(bench: Bench) -> None:
    bench.drive()
    bench.device("signal_generator").sine(10.0, 1.0)


def is_closed(bench: Bench) -> bool:
    modbus = (
        bench.device("signal_generator").link,
        bench.device("shaker_amplifier").link,
        bench.device("strain_indicator").link,
    )
    return not any(link._client.connected for link in modbus) and bench.device("sensor_node_1").link._network is None
