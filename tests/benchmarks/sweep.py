"""Sweeps as a user runs them, all bytes on real sockets and buses: the default one, the three arrangements."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.benchmarks.in_turn import beside, in_turn
from tests.benchmarks.load import busy
from tests.benchmarks.row import Row

GOAL, SWITCHES, PROCESS, STRETCH = 1000, 650, 1.7, 1.3
ROUNDS, FEWER = 5, 2
BUSY = 10
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


def measure() -> Iterator[Row]:
    runs = in_turn(RUN, ROUNDS)
    walls, cpus, switches = ([run[name] for run in runs] for name in ("wall", "cpu", "switches"))
    faster = runs[0]["bench"] / walls[0]
    text = f"{runs[0]['bench']:.0f} s / {beside(walls, '{:.2f} s'.format)} = {faster:.0f}"
    yield Row("default sweep, run part: bench time / wall time", text, f">= {GOAL}", faster >= GOAL)
    yield Row("the same, processor time", beside(cpus, "{:.2f} s".format))
    yield Row(
        "the same, switches of threads", beside(switches, "{:.0f}".format), f"<= {SWITCHES}", switches[0] <= SWITCHES
    )
    with busy(BUSY):
        among = in_turn(RUN, FEWER)
        bare = [in_turn(LOOP % run["cpu"], FEWER)[0] for run in among]
    ratios = [run["wall"] / loop["wall"] for run, loop in zip(among, bare, strict=True)]
    yield Row(
        f"the same beside {BUSY} busy processes / a bare loop of the same processor time",
        beside(ratios, "{:.2f}".format), f"<= {STRETCH}", ratios[0] <= STRETCH,
    )  # fmt: skip
    whole = [each["cpu"] for each in in_turn(WHOLE, ROUNDS)]
    yield Row(
        "the same, whole process with imports and plot, processor time", beside(whole, "{:.2f} s".format),
        f"<= {PROCESS} s", whole[0] <= PROCESS,
    )  # fmt: skip
    three = [_swept("sweep", "loads", "--scene", scene, "--loads", loads) for scene, loads in ARRANGEMENTS.items()]
    yield _speed(f"three arrangements, {sum(len(result['points']) for result in three)} points", three)
    rejected = sum(point["attempts"] - 1 for result in three for point in result["points"])
    settling = [point["settling_s"] for result in three for point in result["points"]]
    yield Row(
        "settling found at a point, mean and most; repeated",
        f"{_mean(settling):.1f}, {max(settling):.1f} s; {rejected}",
    )


def _swept(*arguments: str) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [str(Path(sys.executable).with_name("palpate")), *arguments, "--json"],
            cwd=folder, stdout=subprocess.PIPE, check=True,
        )  # fmt: skip
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def _speed(figure: str, results: list[dict[str, Any]]) -> Row:
    bench, wall = (sum(result[name] for result in results) for name in ("bench_seconds", "wall_seconds"))
    return Row(
        f"{figure}: bench time / wall time",
        f"{bench:.0f} / {wall:.1f} s = {bench / wall:.0f}",
    )


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
