"""Whether prices of effects can be measured again: two campaigns of one scene, compared by their own uncertainties.

Other work on the machine makes all prices larger, so that only an idle one tells; its load is told beside them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator

from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.weights import priced
from tests.benchmarks.row import Row

SCENE = "everything"
FARTHEST, FAR, SHARE = 3.0, 2.0, 0.9


def measure() -> Iterator[Row]:
    scene = read_scene(SCENE)
    loads, campaigns = [], []
    for _ in range(2):
        loads.append(os.getloadavg()[0])
        campaigns.append(priced(scene, Question()))
    apart = {}
    for name, first in campaigns[0].items():
        again = campaigns[1][name]
        apart[f"a of {name or 'the whole'}"] = (again.a_s - first.a_s) / math.hypot(first.u_a_s, again.u_a_s)
        apart[f"b of {name or 'the whole'}"] = (again.b_s_per_s - first.b_s_per_s) / math.hypot(
            first.u_b_s_per_s, again.u_b_s_per_s
        )
        yield Row(
            f"price of {name or f'scene {SCENE}'}, ms; µs/s", " | ".join("; ".join(p.texts()) for p in (first, again))
        )
    near, busy = sum(abs(z) < FAR for z in apart.values()) / len(apart), " and ".join(f"{load:.1f}" for load in loads)
    worst = max(apart, key=lambda name: abs(apart[name]))
    yield Row(
        f"{len(apart)} prices measured again, machine's load {busy}: the farthest apart",
        f"{worst}, {abs(apart[worst]):.1f} standard uncertainties",
        f"< {FARTHEST:g}",
        abs(apart[worst]) < FARTHEST,
    )
    yield Row(f"the same: within {FAR:g}", f"{100 * near:.0f} %", f">= {100 * SHARE:.0f} %", near >= SHARE)
