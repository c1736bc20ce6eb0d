"""Random SIGKILLs over small sweeps, each resumed and compared with one that was not interrupted.

Half of the resumed runs are killed again. Beside each kill the amplifier's output after the watchdog's time is looked
at, in a bench that nobody speaks to any more.
"""

from __future__ import annotations

import random
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from palpate.instrument.errors import RecordError
from palpate.procedures.records.chain import RECORD
from palpate.procedures.records.damage import check
from palpate.procedures.records.run import Run
from tests.benchmarks.row import Row
from tests.kills import Commands

KILLS = 1000
WORKERS = 4  # each waits for the others' turn most of the time
SEED = 6
LONGEST = 0.1  # s of the wall, from the look at the watchdog to the kill
SWEEP = ("sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--out")


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as store, ThreadPoolExecutor(WORKERS) as pool:
        shares = [(Path(store) / str(worker), random.Random(SEED + worker)) for worker in range(WORKERS)]
        counts = sum(pool.map(lambda share: _kill(*share, KILLS // WORKERS), shares), Counter[str]())
    kills = counts["kills"]
    yield Row("random SIGKILLs over sweeps, of them in resumed runs", f"{kills}, {counts['again']}", f"{KILLS}")
    yield Row("  that came while the amplifier drove; before the first point", f"{counts['driven']}, {counts['early']}")
    for what in ("acknowledged points lost", "unreadable runs", "resumed runs that differ", "outputs left on"):
        yield Row(f"  {what}", str(counts[what]), "0", not counts[what])


def _kill(store: Path, chance: random.Random, kills: int) -> Counter[str]:
    """What came of so many kills, by name."""
    found = Counter[str]()
    with Commands() as commands:
        ticks = commands.run(*SWEEP, str(store / "whole")).ticks
        whole = Run.open(store / "whole")
        while found["kills"] < kills:
            folder = store / "cut"
            command: tuple[str, ...] = (*SWEEP, str(folder))
            while found["kills"] < kills:
                end = commands.killed(chance.randrange(1, ticks), LONGEST * chance.random(), *command)
                found["kills"] += end.status < 0
                found["driven"] += bool(end.driven)
                found["outputs left on"] += end.left not in (None, 0.0)
                if not (folder / RECORD).exists():
                    found["acknowledged points lost"] += end.reported
                    break
                faults = check(folder).faults
                found["unreadable runs"] += bool(faults)
                points = 0 if faults else len(Run.open(folder).points())
                found["acknowledged points lost"] += max(0, end.reported - points)
                found["early"] += not points
                command = ("runs", "resume", str(folder), "--quiet")
                if end.status == 0 or chance.random() < 0.5:
                    break
                found["again"] += 1
            if (folder / RECORD).exists():
                done = commands.run(*command).status == 0 or check(folder).status == "complete"
                found["resumed runs that differ"] += not (done and _equal(Run.open(folder), whole))
                shutil.rmtree(folder)
    return found


def _equal(run: Run, whole: Run) -> bool:
    try:
        return (run.digest(), run.summary, run.status) == (whole.digest(), whole.summary, "complete")
    except RecordError:
        return False
