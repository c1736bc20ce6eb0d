"""A million tries with a reply that is repeated up to two time-outs later, on wires that do not number their frames.

Resumable: each ten thousand goes to `stale-VERSION.jsonl` in `$PALPATE_CAMPAIGN` (`campaigns`), VERSION being that of
the code; a command that is given again goes on from there. `$PALPATE_TRIES` says how many.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.row import Row
from tests.stale import NONE, TOLD, tried

TRIES = 1_000_000
BLOCK = 10_000
ROOT = Path(__file__).parents[2]
TRIED = ("drivers/**/*.py", "tests/stale.py", "tests/drivers/virtual_line.py")


def measure() -> Iterator[Row]:
    """Each figure over all tries so far."""
    goal = int(os.environ.get("PALPATE_TRIES", TRIES))
    file = Path(os.environ.get("PALPATE_CAMPAIGN", "campaigns")) / f"stale-{_version()}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    done = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    for library in ("pymodbus", "pymodbus.logging", "canopen"):
        logging.getLogger(library).setLevel(logging.CRITICAL)  # of each reply that does not come
    with file.open("a") as out:
        for block in range(len(done), -(-goal // BLOCK)):
            done.append(tried(block, BLOCK))
            print(json.dumps(done[-1]), file=out, flush=True)
    found = sum(map(Counter, done), Counter[str]())
    tries = sum(count for what, count in found.items() if what.endswith(": tries"))
    yield Row("replies that come twice, up to two time-outs apart", f"{tries} tries", f"{goal}", tries >= goal)
    for what in NONE:
        yield Row(f"  {what}", f"{found[what]} of {found[_tries(what)]}", "0", not found[what])
    for what in TOLD:
        of = found[_tries(what)]
        yield Row(f"  {what}", f"{found[what]} of {of} = {found[what] / of:.2%}")


def _tries(what: str) -> str:
    kind = what.partition(":")[0]
    return f"{ {'lengths alike': 'lengths differ', 'polls alike': 'polls'}.get(kind, kind) }: tries"


def _version() -> str:
    """A hash of all code that is tried."""
    code = b"".join(file.read_bytes() for pattern in TRIED for file in sorted(ROOT.glob(pattern)))
    return hashlib.sha256(code).hexdigest()[:8]
