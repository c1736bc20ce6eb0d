"""A bench that answers in the waits of its client, as `open_bench` opens it: it has no thread, and nothing is lost."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import serial

import palpate
from palpate.drivers.bench import Bench
from palpate.drivers.devices.load_indicator import StrainIndicator
from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.roles import LoadIndicator
from palpate.instrument.contracts.contract import PROBE
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.devices.exciter import SimulatedSignalGenerator
from palpate.simulators.planning.settle import read_scene

DEVICES = ("signal_generator", "strain_indicator", "sensor_node_1")  # on TCP, on the line, on CAN


@contextmanager
def opened(**scene: Any) -> Iterator[Bench]:
    with palpate.open_bench(**scene) as bench:
        yield bench.bench


def probes(bench: Bench) -> set[float]:
    return {bench.device(name).get("probe") for name in DEVICES}


def test_a_bench_of_ones_own_starts_no_thread() -> None:
    before = threading.enumerate()
    with opened(scene="ideal") as bench:
        assert probes(bench) == {PROBE}
        assert threading.enumerate() == before


def test_two_benches_in_one_process_answer_each_their_own_client() -> None:
    with opened(scene="ideal", seed=1) as one, opened(scene="ideal", seed=2) as other:
        one.device("signal_generator").set(frequency=7.0)
        other.device("signal_generator").set(frequency=9.0)
        one.clock.wait(2.0)
        assert [each.device("signal_generator").get("frequency") for each in (one, other)] == [7.0, 9.0]
        assert probes(one) == probes(other) == {PROBE}
        assert one.clock.now_ns() - other.clock.now_ns() == pytest.approx(2e9, abs=0.5e9)


def test_a_bench_is_used_inside_a_running_event_loop_as_a_notebook_has_one() -> None:
    async def cell() -> set[float]:
        with opened(scene="ideal") as bench:
            return probes(bench)

    assert asyncio.run(cell()) == {PROBE}


def test_the_serial_line_is_no_terminal_and_is_opened_again_as_one() -> None:
    """Each write to a terminal wakes a thread of the kernel, which takes the processor from the program."""
    with SimulatedBench(read_scene("ideal"), stepped=True) as sim:
        line = sim.description.links["line"]
        indicator = StrainIndicator(ModbusLink.rtu(line, sim.clock, sim.clock.stepper), 1, sim.clock)
        for _ in range(2):
            indicator.link.open()
            assert indicator.get("probe") == PROBE
            with serial.Serial(line.port, exclusive=True):  # refused where the terminal is in use
                pass
            indicator.link.close()


def test_threads_share_a_bench() -> None:
    with opened(scene="ideal") as bench:
        found: list[set[float]] = []
        threads = [threading.Thread(target=lambda: found.append(probes(bench))) for _ in range(4)]
        for thread in threads:
            thread.start()
        bench.role(LoadIndicator).read()
        for thread in threads:
            thread.join()
        assert found == 4 * [{PROBE}]


def test_a_client_is_answered_though_another_program_asks_without_end() -> None:
    """Private, because no other program asks as fast as that for sure."""
    with palpate.open_bench(scene="ideal") as bench:
        stepper = bench.bench.links["line"].client._stepper  # type: ignore[union-attr]
        assert stepper is not None
        stepper.take_turns(lambda: True)
        assert probes(bench.bench) == {PROBE}


@pytest.mark.parametrize(("number", "raised"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)])
def test_a_signal_in_the_middle_of_what_a_device_does_ends_the_program_after_it(
    foreground: None, number: signal.Signals, raised: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a device would be left half changed, and could no longer be switched off."""
    done: list[str] = []
    write = SimulatedSignalGenerator.write

    def interrupted(device: SimulatedSignalGenerator, values: dict[str, float]) -> None:
        if "frequency" in values and not done:
            done.append("begun")
            signal.raise_signal(number)
            done.append("ended")
        write(device, values)

    with pytest.raises(raised) as ended, opened(scene="ideal") as bench:
        monkeypatch.setattr(SimulatedSignalGenerator, "write", interrupted)
        bench.device("signal_generator").set(frequency=7.0)
    assert done == ["begun", "ended"]
    assert "the outputs are off" in str(ended.value.__notes__)
