"""Hostile scenes: every number of every scene, effect and fault at values that no bench has.

Each case is a sweep of one point by the command line, in a process of its own. `$PALPATE_CASES` says how many cases are
tried (drawn by a seed; without: all of them, which takes hours); `$PALPATE_STEEP=1` adds powers of ten up to
1e100, and the limits of each number.
"""

from __future__ import annotations

import os
import random
from collections import Counter
from collections.abc import Iterator
from multiprocessing import get_context

from tests.benchmarks.row import Row
from tests.hostile_scenes import HOSTILE, LIMIT, STEEP, Came, Case, cases, ready, scenes, swept

SEED = 35


def measure() -> Iterator[Row]:
    steep = bool(os.environ.get("PALPATE_STEEP"))
    listed = list(cases(HOSTILE + STEEP * steep, ends=steep))
    random.Random(SEED).shuffle(listed)
    goal = len(listed)
    listed = listed[: int(os.environ.get("PALPATE_CASES", goal))]
    with get_context("spawn").Pool(os.cpu_count(), ready) as pool:
        found = list(pool.imap_unordered(_tried, listed))
    bad = Counter(came.bad.partition(" ")[0] for _, came in found if came.bad)
    longest = max(came.seconds for _, came in found if came.status)
    worked = sum(came.status == 0 for _, came in found)
    yield Row(f"hostile numbers in {len(scenes())} scenes", f"{len(found)}", f"{goal}", len(found) == goal)
    yield Row("  that give a result, one message", f"{worked}, {len(found) - worked - bad.total()}")
    yield Row("  that hang, take long, or give anything else", str(bad.total()), "0", not bad)
    yield Row("  longest until a message, s of the processor", f"{longest:.1f}", f"{LIMIT:g}", longest <= LIMIT)
    for case, came in found:
        if came.bad:
            yield Row(f"  {case} {came.bad}", " ".join(came.said[-300:].split()))


def _tried(case: Case) -> tuple[Case, Came]:
    return case, swept(case.content)
