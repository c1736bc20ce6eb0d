"""How long it takes from `palpate new …` to the tests of one's own package passing, beside an installed palpate.

Each package is written, installed by `pip install -e` and tested, one after the other, as the guides say.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.row import Row

ROOT = Path(__file__).parents[2]
BEGUN = {
    "a sensor on Modbus TCP": "device own_gauge --kind sensor",
    "a CANopen actuator": "device own_valve --bus canopen",
    "an effect": "effect own_sag",
    "a procedure": "procedure own_scatter",
    "a bench with both devices": "bench own_corner --device own-gauge --device own-valve",
}


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        own = {name: value for name, value in os.environ.items() if name != "VIRTUAL_ENV"}
        own["PATH"] = f"{folder}/.venv/bin:{own['PATH']}"

        def done(command: str) -> float:
            start = time.perf_counter()
            subprocess.run(command, shell=True, cwd=folder, check=True, capture_output=True, env=own)
            return time.perf_counter() - start

        installed = done(f"python3 -m venv .venv && pip install -q -e {ROOT} pytest-timeout hatchling editables")
        yield Row("palpate itself is installed, pip", f"{installed:.0f} s")
        for what, words in BEGUN.items():
            name = words.split()[1]
            written = done(f"palpate new {words}")
            put = done(f"pip install -q --no-build-isolation -e {name}") if "bench" not in words else 0.0
            tested = done(f"cd {name} && pytest -q")
            told = f"{written + put + tested:.0f} s (written {written:.1f}, installed {put:.1f}, tested {tested:.1f})"
            yield Row(f"palpate new {words.split()[0]} to tests passed: {what}", told)
