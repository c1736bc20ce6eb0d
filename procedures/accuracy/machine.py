"""Timing of calls on this machine, and a description of the machine."""

from __future__ import annotations

import os
import platform
import time
import timeit
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from palpate.instrument.models.price_list import Machine


def seconds_of(call: Callable[[], object]) -> float:
    """Processor time of one call [s]: the least of five rounds of 20 ms or more."""
    timer = timeit.Timer(call, timer=time.process_time)
    count = 1
    while timer.timeit(count) < 0.02:
        count *= 2
    return min(timer.repeat(5, count)) / count


def this_machine() -> Machine:
    """Name of the processor, where the system tells it, and today's date."""
    cpu = platform.processor() or platform.machine()
    information = Path("/proc/cpuinfo")
    if information.exists():
        named = [line for line in information.read_text().splitlines() if line.startswith("model name")]
        cpu = named[0].partition(":")[2].strip() if named else cpu
    return Machine(
        cpu=cpu,
        cores=os.cpu_count() or 1,
        system=f"{platform.system()} {platform.machine()}",
        python=platform.python_version(),
        date=datetime.now(UTC).date().isoformat(),
    )
