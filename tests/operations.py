"""Counts of what palpate's own code does: figures that no machine and no neighbour changes."""

from __future__ import annotations

import sys
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from unittest.mock import patch

from palpate.drivers.bench import Bench
from palpate.procedures.steps.policy import carry_out
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.scenes.scene import Scene

PACKAGE = Path(__file__).parents[1] / "palpate"  # through whose links the folders are imported
OWN = tuple(f"{PACKAGE / name}/" for name in ("instrument", "drivers", "simulators", "procedures"))

# Two look at the line as often as the machine lets them, one at lock files that other programs make and remove.
NOT_COUNTED = (
    *(f"{PACKAGE}/drivers/links/modbus.py:{name}" for name in ("readable", "ReplyFramer", "RtuClient")),
    f"{PACKAGE}/simulators/wire/loop.py:Loop",
    f"{PACKAGE}/drivers/bench_lock.py:",
)


def operations(scene: Scene) -> Counter[str]:
    """Calls of each function of palpate's in the life of a scene's bench, in all threads.

    It is opened, attended, driven, read on every bus and closed.
    """
    calls = Counter[str]()

    def count(frame: FrameType, event: str, _what: object) -> None:
        file = frame.f_code.co_filename
        called = f"{file}:{frame.f_code.co_qualname}"
        if event == "call" and file.startswith(OWN) and not called.startswith(NOT_COUNTED):
            calls[called] += 1

    threading.setprofile(count)
    sys.setprofile(count)
    try:
        with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
            bench.attend(lambda *_: None)
            bench.device("signal_generator").sine(10.0, 0.1)
            carry_out(bench, "driving", bench.drive)
            carry_out(bench, "films", lambda: bench.device("sensor_node_1").acquire(0.2))
            carry_out(bench, "load", bench.device("strain_indicator").read)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return calls


@contextmanager
def without_code_of_faults() -> Iterator[None]:
    """Nothing of `palpate.simulators.faults` can be imported."""
    loaded = [name for name in sys.modules if name.startswith("palpate.simulators.faults.")]
    with patch.dict(sys.modules, dict.fromkeys(["palpate.simulators.faults", *loaded])):
        yield
