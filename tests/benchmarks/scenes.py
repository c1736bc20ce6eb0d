"""What effects cost: nothing where they are not called for, nanoseconds a sample where they are."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import numpy as np

from palpate.drivers.bench import Bench
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.contracts.own import CHANNELS
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.lab import Lab
from palpate.procedures.measurements.loads import LoadSweep
from palpate.procedures.records.record import Recorder
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
from tests.benchmarks.records import HEADER
from tests.benchmarks.row import Row

SAMPLE_NS = 1_000_000
POLE_SECONDS = 100
STEPS = 65536  # that are followed one after the other
BLOCK, AT_ONCE = 16384, 1000  # samples: with so many Python's own time is little; so many a sweep asks for at once
ROUNDS = 15
LARGE = 4_000_000
GOAL_STEPPED, GOAL_POLE, GOAL_STEADY = 100.0, 5.0, 50e-6
GOAL_IDEAL, SWEEP_ROUNDS = 3.0, 5
DEFAULT = LoadSweep()

Taker = Callable[[int, int], None]


def measure() -> Iterator[Row]:
    yield from _unused()
    yield from _stepped()
    yield from _steady()
    yield from _sweeps()


# --- an unused effect ----------------------------------------------------------------------------------


def _unused() -> Iterator[Row]:
    """The scene with one effect, in a process that knows all effects and in one that knows that effect alone."""
    registered = {count: _in_a_process(count) for count in ("all", "one")}
    ratio = registered["all"][0] / registered["one"][0]
    yield Row(
        f"1 effect of {len(EFFECTS)} against a build with that one: calls",
        f"{registered['all'][0]:.0f} / {registered['one'][0]:.0f} = {ratio:.4f}",
        "1.00 ± 0.02",
        abs(ratio - 1) <= 0.02,
    )
    times = [registered[count][1] for count in ("all", "one")]
    yield Row("the same, CPU time", f"{1e3 * times[0]:.1f} / {1e3 * times[1]:.1f} ms = {times[0] / times[1]:.2f}", "1")


def _in_a_process(registered: str) -> tuple[float, float]:
    code = f"from tests.benchmarks.scenes import one_effect; one_effect({registered!r})"
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, check=True)
    calls, seconds = json.loads(done.stdout)
    return calls, seconds


def one_effect(registered: str) -> None:
    """Prints calls and CPU seconds of a scene with the charge amplifier alone; everything imported before."""
    if registered == "one":
        for name in [name for name in EFFECTS if name != "charge_amplifier"]:
            del EFFECTS[name]
    thesis = read_scene("thesis_single") if registered == "all" else None
    if thesis is None:
        thesis = read_scene(_plain_scene())
    scene = dataclasses.replace(thesis, effects={"charge_amplifier": thesis.effects["charge_amplifier"]})
    _first_second(scene)
    calls = 0

    def count(_frame: FrameType, event: str, _what: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        _first_second(scene)
    finally:
        sys.setprofile(None)
    print(json.dumps([calls, _least(lambda: _first_second(scene))]))  # noqa: T201


def _plain_scene() -> str:
    text = 'name = "one"\npurpose = "One effect."\ndesign = "single"\n[effects.charge_amplifier]\n'
    file = Path(tempfile.mkdtemp()) / "one.toml"
    file.write_text(text, encoding="utf-8")
    return str(file)


# --- samples -------------------------------------------------------------------------------------------


def _stepped() -> Iterator[Row]:
    np.ones(LARGE)  # until such a one has been freed, glibc asks for new pages each time, which take longer than sines
    count = POLE_SECONDS * SECOND // SAMPLE_NS
    time_ns = np.arange(count) * SAMPLE_NS
    plain = _least(lambda: np.sin(2 * np.pi * 10e-9 * time_ns)) / count

    def row(what: str, each: float, goal: float) -> Row:
        measured = f"{1e9 * each:.1f} ns = {each / plain:.1f} plain sines"
        return Row(what, measured, f"<= {goal:.0f} ns", 1e9 * each <= goal)

    pole, drive = first_order_high_pass(1.0), _sine(1.0)
    trace = pole.drive((drive,)).trace((pole.c, pole.d), 0, np.zeros(1))
    yield Row("plain vectorised sine, a sample", f"{1e9 * plain:.1f} ns")
    yield row("one pole, a sample", _least(lambda: trace.at(time_ns, SAMPLE_NS)) / count, GOAL_POLE)
    for name in ("everything", "overdriven"):
        each, in_pieces = (_each(read_scene(name), block) for block in (BLOCK, AT_ONCE))
        yield row(f"scene {name!r}, a sample and channel of a node's {CHANNELS}", each, GOAL_STEPPED)
        yield Row(f"the same, {AT_ONCE} samples at a time", f"{1e9 * in_pieces:.1f} ns")
        begin = _least(functools.partial(_first_second, read_scene(name)))
        yield Row("the same, set-up and the first second", f"{1e3 * begin:.0f} ms")


def _each(scene: Scene, block: int) -> float:
    """CPU seconds a sample and channel, in blocks of so many samples."""
    take, firsts = _followed(scene), itertools.count(1, block)

    def some() -> None:
        for first in itertools.islice(firsts, STEPS // block):
            take(first, first + block)

    some()  # first transitions, and what is worked out once
    return _least(some) / (STEPS // block * block) / CHANNELS


def _followed(scene: Scene) -> Taker:
    """Takes samples of all films, from one to before another, counted from when the drive is set to 3 N."""
    rig = driven(scene, Question())
    node = SimulatedSensorNode(VirtualClock(), 1, 1, rig)

    def take(first: int, end: int) -> None:
        time_ns = np.arange(first, end) * SAMPLE_NS
        node.sample(time_ns, node.film_channels @ rig.film_voltages(time_ns, SAMPLE_NS), SAMPLE_NS)

    return take


def _first_second(scene: Scene) -> None:
    _followed(scene)(1, SECOND // SAMPLE_NS + 1)


def _sine(amplitude: float) -> Periodic:
    return Periodic(0.0, 10 * HERTZ, 0, 0, np.array([1]), np.array([-1j * amplitude]))


# --- steady state and sweeps ---------------------------------------------------------------------------


def _steady() -> Iterator[Row]:
    rig = Rig(read_scene("thesis_single"), VirtualClock())
    rig.mount(get_sample("2"))
    rig.set_position(14e-3)
    rig.transfer(10.0)
    calls = 200
    each = _least(lambda: [rig.transfer(10.0) for _ in range(calls)]) / calls
    yield Row(
        "steady state in closed form", f"{1e6 * each:.0f} us", f"< {1e6 * GOAL_STEADY:.0f} us", each < GOAL_STEADY
    )


def _sweeps() -> Iterator[Row]:
    """Times of the default sweep, on the wire and to the disk, without imports and plot, which every sweep has."""
    scenes = [read_scene(name) for name in ("thesis_single", "ideal", "everything")]
    rounds = [[_sweep(scene) for scene in scenes] for _ in range(SWEEP_ROUNDS)]  # in turn: a machine has its moods
    seconds = {scene.name: min(taken) for scene, taken in zip(scenes, zip(*rounds, strict=True), strict=True)}
    for name, least in seconds.items():
        yield Row(f"sweep of scene {name!r}: CPU time", f"{least:.2f} s")
    ratio = seconds["everything"] / seconds["ideal"]
    yield Row("the same, 'everything' / 'ideal'", f"{ratio:.1f}", f">= {GOAL_IDEAL:.0f}", ratio >= GOAL_IDEAL)


def _sweep(scene: Scene) -> float:
    """CPU seconds of the process, which is driver, device and disk at once."""
    with (
        SimulatedBench(scene) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
        tempfile.TemporaryDirectory() as folder,
    ):
        start = time.process_time()
        with Recorder.create(Path(folder) / "run", HEADER) as record:
            result = conduct(DEFAULT, Lab(bench, scene.design, THESIS_LOAD_CELL), record)
            record.finish("complete", result.summary())
        return time.process_time() - start


def _least(call: Callable[[], object]) -> float:
    """CPU seconds of a call, the least of some: what other processes take is not counted."""
    taken = []
    for _ in range(ROUNDS):
        start = time.process_time()
        call()
        taken.append(time.process_time() - start)
    return min(taken)
