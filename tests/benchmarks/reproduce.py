"""`palpate reproduce` as a user runs it: how long it takes, and how much of the thesis it meets."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.row import Row

GOAL_S = 60.0


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        done = subprocess.run(
            [str(Path(sys.executable).with_name("palpate")), "reproduce", "--json"],
            cwd=folder, stdout=subprocess.PIPE, check=False,  # exit status 1: rows outside their scatter
        )  # fmt: skip
        took = time.perf_counter() - start
    found = json.loads(done.stdout)
    yield Row("reproduce: whole process", f"{took:.1f} s", f"< {GOAL_S:.0f} s", took < GOAL_S)
    for name, one in found["evidence"].items():
        share = "" if one["share"] is None else f" = {one['share']:.1%}"
        yield Row(
            f"reproduce, {name}: rows within their stated scatter", f"{one['within']} of {one['judged']}{share}",
            one["required"], one["met"],
        )  # fmt: skip
    for design, right in found["softness_order_right"].items():
        yield Row(f"reproduce: softness order, {design}", "right" if right else "wrong", "right", right)
