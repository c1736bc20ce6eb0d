"""What a bench of its own costs a test: the plugin's, as the fixture `bench` opens and closes it."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.procedures.testing.benches import simulated_bench
from palpate.simulators.planning.settle import read_scene
from tests.benchmarks.in_turn import beside, in_turn
from tests.benchmarks.row import Row
from tests.conftest import open_ends

GOAL = 0.01  # s
ROUNDS = 3
SCENES = ("thesis_single", "noisy_lab")
SCRIPT = """
import statistics
from palpate.procedures.testing.benches import simulated_bench
from palpate.simulators.planning.settle import read_scene
scene, taken = read_scene({scene!r}), []
for _ in range(25):
    before = used()
    with simulated_bench(scene) as watch, watch.bench:
        pass
    taken.append(spent(before))
print(json.dumps({{name: statistics.median(each[name] for each in taken) for name in ("cpu", "wall")}}))
"""


def measure() -> Iterator[Row]:
    for name in SCENES:
        found = in_turn(SCRIPT.format(scene=name), ROUNDS)
        walls, cpus = ([1e3 * each[what] for each in found] for what in ("wall", "cpu"))
        text = f"{beside(walls, '{:.1f} ms'.format)} (processor {beside(cpus, '{:.1f} ms'.format)})"
        yield Row(f"bench fixture, {name}: up and down", text, f"<= {1e3 * GOAL:.0f} ms", walls[0] <= 1e3 * GOAL)
        before = open_ends()
        with simulated_bench(read_scene(name)) as watch, watch.bench:
            pass
        left = len(open_ends() - before)
        yield Row(f"bench fixture, {name}: threads, sockets, ptys left", f"{left}", "0", left == 0)
