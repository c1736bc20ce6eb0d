"""The physics of the default runs beside the thesis."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.benchmarks.row import Row

REPEATABILITY = 0.041  # of the force ratio, single sensor, Tables A2.9 to A2.14
THESIS_ORDER = ["1", "6", "4", "3", "5", "2"]  # Figure 5.3


def measure() -> Iterator[Row]:
    sweep = _run("sweep", "loads")
    for sample in sweep["samples"]:
        off = sample["force_ratio"] / sample["thesis_force_ratio"] - 1
        yield Row(
            f"sample {sample['sample']}: mean force ratio",
            f"{sample['force_ratio']:.4f}, u {sample['force_ratio_u']:.4f}, {100 * off:+.1f} % of the thesis'",
            f"within {100 * REPEATABILITY:.1f} %",
            abs(off) <= REPEATABILITY,
        )
    order = sweep["softness_order"]
    yield Row("softness order", " > ".join(order), " > ".join(THESIS_ORDER), order == THESIS_ORDER)
    cell = _run("calibrate", "load-cell")
    sensitivity = cell["sensitivity_mV_per_N"]
    yield Row(
        "load-cell sensitivity",
        f"{sensitivity:.3f} mV/N, u {cell['sensitivity_u']:.3f}",
        "10.3 ± 0.1 mV/N",
        abs(sensitivity - 10.3) <= 0.1,
    )


def _run(*command: str) -> dict[str, Any]:
    palpate = str(Path(sys.executable).with_name("palpate"))
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run([palpate, *command, "--json"], cwd=folder, stdout=subprocess.PIPE, check=True)
    result: dict[str, Any] = json.loads(done.stdout)
    return result
