"""Sweeps as a user runs them, long dwells, what effects cost, and thirty bench days on one bench."""

from __future__ import annotations

import itertools
import json
import math
import resource
import shutil
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from palpate.drivers.bench import Bench
from palpate.drivers.devices.sensor_node import CanopenSensorNode, in_pieces
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.contracts.own import CHANNELS
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.estimate import Sums
from palpate.procedures.measurements.loads import LoadSweep
from palpate.procedures.steps.checks import preload_for
from palpate.procedures.steps.films import Films
from palpate.procedures.steps.probe import press
from palpate.procedures.steps.servo import LoadServo
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.effects import EFFECTS
from palpate.simulators.linear.lti import first_order_high_pass
from palpate.simulators.linear.periodic import HERTZ, SECOND, Periodic
from palpate.simulators.planning.plan import Question, driven
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.rig import Rig
from palpate.simulators.scenes.scene import Scene
from tests.benchmarks.common import (
    Row,
    at_least,
    at_most,
    beside,
    in_turn,
    least,
    measured,
    opened,
    palpate,
    pressed,
    spent,
)
from tests.benchmarks.wire import busy

# --- the default sweep ---------------------------------------------------------------------------------

RUN = """
import palpate
with palpate.open_bench() as bench:
    bench_ns, before = bench.bench.clock.now_ns(), used()
    palpate.run(palpate.LoadSweep(), bench, out="run")
    print(json.dumps(spent(before) | {"bench": 1e-9 * (bench.bench.clock.now_ns() - bench_ns)}))
"""
WHOLE = """
import contextlib, io
from palpate.procedures.commands import main
sys.argv = ["palpate", "sweep", "loads", "--json"]
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    main()
print(json.dumps({"cpu": used()["cpu"]}))
"""
LOOP = """
before = used()
while used()["cpu"] - before["cpu"] < %s:
    pass
print(json.dumps(spent(before)))
"""
ARRANGEMENTS = {
    "thesis_single": "1.5 N:4 N:0.5 N",  # A2.9 to A2.14
    "thesis_common_base": "1.5 N:4.5 N:0.5 N",  # A2.15 to A2.20
    "thesis_different_base": "1.5 N:4.5 N:0.5 N",
}


def sweep(rounds: int = 5, fewer: int = 2) -> Iterator[Row]:
    """Sweeps as a user runs them, all bytes on real sockets and buses: the default one, the three arrangements."""
    runs = in_turn(RUN, rounds)
    walls, cpus, switches = ([run[name] for run in runs] for name in ("wall", "cpu", "switches"))
    faster = runs[0]["bench"] / walls[0]
    yield at_least(
        "default sweep, run part: bench time / wall time",
        faster,
        1000,
        "{:.0f}",
        f"{runs[0]['bench']:.0f} s / {beside(walls, '{:.2f} s'.format)} = {faster:.0f}",
    )
    yield Row("the same, processor time", beside(cpus, "{:.2f} s".format))
    yield at_most("the same, switches of threads", switches[0], 650, "{:.0f}", beside(switches, "{:.0f}".format))
    with busy(10):
        among = in_turn(RUN, fewer)
        bare = [in_turn(LOOP % run["cpu"], fewer)[0] for run in among]
    ratios = [run["wall"] / loop["wall"] for run, loop in zip(among, bare, strict=True)]
    yield at_most(
        "the same beside 10 busy processes / a bare loop of the same processor time",
        ratios[0],
        1.3,
        "{:.2f}",
        beside(ratios, "{:.2f}".format),
    )
    whole = [each["cpu"] for each in in_turn(WHOLE, rounds)]
    yield at_most(
        "the same, whole process with imports and plot, processor time",
        whole[0],
        1.7,
        "{:.1f} s",
        beside(whole, "{:.2f} s".format),
    )
    told = [palpate("sweep", "loads", "--scene", *of, "--json") for of in _options("--loads", ARRANGEMENTS)]
    three = [json.loads(each) for each in told]
    took, wall = (sum(result[name] for result in three) for name in ("bench_seconds", "wall_seconds"))
    yield at_least(
        f"three arrangements, {sum(len(result['points']) for result in three)} points: bench time / wall time",
        took / wall,
        100,
        "{:.0f}",
        f"{took:.0f} / {wall:.1f} s = {took / wall:.0f}",
    )


def _options(name: str, values: dict[str, str]) -> Iterator[tuple[str, str, str]]:
    return ((scene, name, value) for scene, value in values.items())


# --- long dwells ---------------------------------------------------------------------------------------


def dwell(hour: float = 3600.0) -> Iterator[Row]:
    """Long dwells at 1 kHz, fitted while they last: an hour of one node, an hour of twenty nodes, a day of one node.

    Each is measured in a process of its own, because the greatest memory of a process never falls. What the memory
    grows by is counted from a first second of the same work on.
    """
    for nodes, hours, what, goal in (
        (1, 1, "an hour of one node", 2.5),
        (20, 1, "an hour of 20 nodes", 30.0),
        (1, 24, "a day of one node", 60.0),
    ):
        worked, grown = dwelt(nodes, hour * hours)
        yield at_most(f"{what} at 1 kHz with fit: processor time", worked, goal, "{:.1f} s")
        yield at_most(f"{what} at 1 kHz with fit: memory", grown, 20, "+{:.1f} MiB")


def dwelt(nodes: int, seconds: float) -> tuple[float, float]:
    """Processor time [s] and growth of memory [MiB] in a process of its own."""
    code = f"from tests.benchmarks.sweep import *; print(json.dumps(dwelt_here({nodes}, {seconds})))"
    worked, grown = json.loads(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True).stdout)
    return worked, grown


def dwelt_here(nodes: int, seconds: float) -> tuple[float, float]:
    """The same in this process."""
    with opened(replace(read_scene("thesis_single"), nodes=nodes), stepped=True) as (_, bench):
        pressed(bench)
        sensors = bench.all(CanopenSensorNode)
        _amplitudes(sensors, 1.0)
        memory = _most_memory()
        worked = spent(lambda: _amplitudes(sensors, seconds)).cpu
        return worked, _most_memory() - memory


def _amplitudes(sensors: list[CanopenSensorNode], seconds: float) -> None:
    first, last = 1e-3, seconds
    sums = [Sums(10.0, (last - first) / 2) for _ in sensors]
    for recordings in in_pieces(sensors, seconds):  # raises where a counter is not continuous
        for each, recording in zip(sums, recordings, strict=True):
            each.add(recording.time - (first + last) / 2, recording.voltage)
    found = [np.hypot(*(each.solve() * each.scale[:, np.newaxis])[:2]) for each in sums]
    assert all(0.0 < each.max() < 1.0 for each in found), "the films feel nothing"


def _most_memory() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


# --- effects -------------------------------------------------------------------------------------------

SAMPLE_NS = 1_000_000
ROUNDS = 15
STEPS = 65536  # that are followed one after the other
BLOCK = 16384  # samples: with so many Python's own time is little
PLAIN = 'name = "one"\npurpose = "One effect."\ndesign = "single"\n[effects.charge_amplifier]\n'


def scenes(rounds: int = 5) -> Iterator[Row]:
    """What effects cost: nothing where they are not called for, nanoseconds a sample where they are."""
    every, one = (_calls_in_a_process(count) for count in ("all", "one"))
    yield Row(
        f"1 effect of {len(EFFECTS)} against a build with that one: calls",
        f"{every:.0f} / {one:.0f} = {every / one:.4f}", "1.00 ± 0.02", abs(every / one - 1) <= 0.02,
    )  # fmt: skip
    yield from _stepped()
    rig = Rig(read_scene("thesis_single"), VirtualClock())
    rig.mount(get_sample("2"))
    rig.set_position(14e-3)
    each = least(lambda: [rig.transfer(10.0) for _ in range(200)], ROUNDS) / 200
    yield at_most("steady state in closed form", 1e6 * each, 50, "{:.0f} us")
    settled = [read_scene(name) for name in ("ideal", "everything")]
    ideal, everything = (
        min(taken) for taken in zip(*([_swept(scene) for scene in settled] for _ in range(rounds)), strict=True)
    )
    yield at_least(
        "sweeps, 'everything' / 'ideal', CPU time",
        everything / ideal,
        3,
        "{:.0f}",
        f"{everything:.2f} / {ideal:.2f} s = {everything / ideal:.1f}",
    )


def _calls_in_a_process(registered: str) -> float:
    """Calls of the scene with one effect, in a process that knows all effects or that one alone."""
    code = f"from tests.benchmarks.sweep import *; one_effect({registered!r})"
    return float(subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, check=True).stdout)


def one_effect(registered: str) -> None:
    """Prints the number of calls of a scene with the charge amplifier alone; everything imported before."""
    with TemporaryDirectory() as folder:
        (file := Path(folder) / "one.toml").write_text(PLAIN, encoding="utf-8")
        if registered == "one":
            for name in [name for name in EFFECTS if name != "charge_amplifier"]:
                del EFFECTS[name]
        whole = read_scene("thesis_single" if registered == "all" else str(file))
    scene = replace(whole, effects={"charge_amplifier": whole.effects["charge_amplifier"]})
    _followed(scene)(1, SECOND // SAMPLE_NS + 1)
    calls = 0

    def count(_frame: object, event: str, _what: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    _followed(scene)(1, SECOND // SAMPLE_NS + 1)
    sys.setprofile(None)
    print(calls)  # noqa: T201


def _stepped() -> Iterator[Row]:
    np.ones(
        4_000_000
    )  # until such a one has been freed, glibc asks for new pages each time, which take longer than sines
    time_ns = np.arange(100 * SECOND // SAMPLE_NS) * SAMPLE_NS
    plain = least(lambda: np.sin(2 * np.pi * 10e-9 * time_ns), ROUNDS) / time_ns.size
    pole = first_order_high_pass(1.0)
    driven_by = pole.drive((Periodic(0.0, 10 * HERTZ, 0, 0, np.array([1]), np.array([-1j])),))
    trace = driven_by.trace((pole.c, pole.d), 0, np.zeros(1))
    costs = {"one pole, a sample": (least(lambda: trace.at(time_ns, SAMPLE_NS), ROUNDS) / time_ns.size, 5)}
    for name in ("everything", "overdriven"):
        costs[f"scene {name!r}, a sample and channel of a node's {CHANNELS}"] = _each(read_scene(name)), 100
    for figure, (each, goal) in costs.items():
        yield at_most(figure, 1e9 * each, goal, "{} ns", f"{1e9 * each:.1f} ns = {each / plain:.1f} plain sines")


def _each(scene: Scene) -> float:
    """CPU seconds a sample and channel."""
    take, firsts = _followed(scene), itertools.count(1, BLOCK)

    def some() -> None:
        for first in itertools.islice(firsts, STEPS // BLOCK):
            take(first, first + BLOCK)

    some()  # first transitions, and what is worked out once
    return least(some, ROUNDS) / STEPS / CHANNELS


def _followed(scene: Scene) -> Callable[[int, int], None]:
    """Takes samples of all films, from one to before another, counted from when the drive is set to 3 N."""
    rig = driven(scene, Question())
    node = SimulatedSensorNode(VirtualClock(), 1, 1, rig)

    def take(first: int, end: int) -> None:
        time_ns = np.arange(first, end) * SAMPLE_NS
        node.sample(time_ns, node.film_channels @ rig.film_voltages(time_ns, SAMPLE_NS), SAMPLE_NS)

    return take


def _swept(scene: Scene) -> float:
    """CPU seconds of the default sweep, on the wire and to the disk, without imports and plot."""
    with opened(scene) as (_, bench), TemporaryDirectory() as folder:
        return spent(lambda: measured(LoadSweep(), bench, scene.design, Path(folder) / "run")).cpu


# --- thirty days ---------------------------------------------------------------------------------------

SMALL = LoadSweep(("1",), (2.0, 3.0), 0.2, 10.0)


def soak(days: int = 30) -> Iterator[Row]:
    """Thirty bench days on one open bench: a small sweep every hour, then a drive that stays on for as long.

    Memory, file handles and processor time a point must not grow; the phase of the films must stay where the
    generator's frequency puts it.
    """
    sweeps = days * 24
    part = sweeps // 10  # that is compared
    with _open_for_long() as (bench, design), _open_for_long() as (new, _), TemporaryDirectory() as folder:
        memory, handles = [], []
        for number in range(sweeps):
            bench.clock.wait(max(0.0, number * 3600.0 - 1e-9 * bench.clock.now_ns()))
            _small_sweep(bench, design, Path(folder))
            memory.append(resident_memory() / 2**20)
            handles.append(float(sum(1 for _ in Path("/proc/self/fd").iterdir())))
        yield Row("sweeps, bench days", f"{sweeps}, {1e-9 * bench.clock.now_ns() / 86_400:.1f}", f"{days} days")
        for what, values, allowed in (("memory, MiB", memory, 1.02), ("file handles", handles, 1.0)):
            first, last = statistics.median(values[part : 2 * part]), statistics.median(values[-part:])
            yield at_most(
                f"  {what}: second and last tenth", last, allowed * first, "{:.4g}", f"{first:.4g}, {last:.4g}"
            )
        longer = []
        for _ in range(part):  # in turn: a machine is faster in one minute than in another
            seconds = []
            for which in (bench, new):
                which.clock.wait(3600.0)
                seconds.append(_small_sweep(which, design, Path(folder)))
            longer.append(math.log(seconds[0] / seconds[1]))
        mean, u = math.expm1(statistics.mean(longer)), statistics.stdev(longer) / math.sqrt(part)
        yield at_most(
            f"  processor time a point then, against a new bench: {part} pairs in turn",
            100 * mean,
            10,
            "{:.0f} % more",
            f"{100 * mean:+.1f} %, u {100 * u:.1f} %",
        )
        yield _drive(bench, design, days)


@contextmanager
def _open_for_long() -> Iterator[tuple[Bench, Design]]:
    """With the longest watchdog, so that a month has not too many requests."""
    with SimulatedBench(read_scene("thesis_single")) as sim:
        description = sim.description.model_copy(update={"watchdog": 60.0})
        with Bench(description, sim.clock, sim.operator) as bench:
            yield bench, sim.scene.design


def _small_sweep(bench: Bench, design: Design, folder: Path) -> float:
    """The processor's seconds of a small sweep."""
    took = spent(lambda: measured(SMALL, bench, design, folder / "run")).cpu
    shutil.rmtree(folder / "run")
    return took


def _drive(bench: Bench, design: Design, days: int) -> Row:
    """The phase of the first film against the bench's clock, at the start and after a month of driving."""
    static = preload_for(SMALL.loads)
    films = Films(bench, design, SMALL.frequency, static + max(SMALL.loads) / 2)
    preloaded = press(bench, THESIS_LOAD_CELL, get_sample("1"), static)
    LoadServo(bench, THESIS_LOAD_CELL, SMALL.frequency, preloaded).set(2.0)
    films.settle(lambda: None)
    phases, us = [], []
    for wait in (0.0, days * 86_400.0):
        bench.clock.wait(wait)
        cycles = bench.clock.now_ns() * round(SMALL.frequency) % 1_000_000_000 / 1e9
        fit = films.fit(films.acquire(10.0))
        phases.append(float(fit.phase[0]) - 2 * math.pi * cycles)
        us.append(float(fit.amplitude_u[0] / fit.amplitude[0]))
    drift, u = abs(math.remainder(phases[1] - phases[0], 2 * math.pi)), math.hypot(*us)
    return at_most(
        f"phase of a film after {days} days of driving, against the start",
        drift,
        3 * u,
        "{:.1e} rad",
        f"{drift:.1e} rad, u {u:.1e}",
    )


def resident_memory() -> int:
    """Memory of this process that is not swapped out [B]."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * resource.getpagesize()
