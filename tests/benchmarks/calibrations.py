"""Kills at every moment of every procedure that calibrates, and failures of each write: is a calibration lost?

Resumable as `served_kills`: each round goes to `calibrations-VERSION.jsonl` in `$PALPATE_CAMPAIGN` (`campaigns`).
`$PALPATE_BLOWS` says how many blows there shall be. Moments follow one another in steps by which the rounds come to all
parts of a run early; a half of them lie behind its last point, where what follows from it is written.
"""

from __future__ import annotations

import json
import os
import random
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.row import Row
from tests.benchmarks.served_kills import _version
from tests.calibration_kills import COMMANDS, ERRORS, FAULTS, Rounds, in_process, served

BLOWS = 1000
END = 60  # moments at the end of a run within which it measures no more and keeps what it has found
COUNTED = ("killed", "killed again", "failed writes")
PLACES = {"in process": in_process, "served": served}
ROUNDS = 25  # with one kind of calibration, before the next


def measure() -> Iterator[Row]:
    """Each figure over all rounds so far."""
    goal = int(os.environ.get("PALPATE_BLOWS", BLOWS))
    file = Path(os.environ.get("PALPATE_CAMPAIGN", "campaigns")) / f"calibrations-{_version()}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    done = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    found: dict[str, Counter[str]] = {place: Counter() for place in PLACES}
    for place, counts in done:
        found[place] += Counter(counts)
    with file.open("a") as out:
        while sum(each[what] for each in found.values() for what in COUNTED) < goal:
            block = len(done) // ROUNDS
            place = tuple(PLACES)[block % 2]
            kind = tuple(COMMANDS)[block // 2 % len(COMMANDS)]
            with tempfile.TemporaryDirectory() as folder, PLACES[place](Path(folder), kind) as rounds:
                for number in range(len(done), (block + 1) * ROUNDS):
                    each = _blow(rounds, number)
                    done.append([place, each])
                    found[place] += each
                    print(json.dumps([place, each]), file=out, flush=True)
    for place, each in found.items():
        said = ", ".join(f"{each[what]} {what}" for what in COUNTED)
        yield Row(f"calibrations {place}: kills and failed writes", said)
        yield Row("  then resumed; installed", f"{each['resumed']}; {each['installed']}")
        yield Row("  told to run anew, as points were missing", str(each["told to run anew, as points were missing"]))
        for what in FAULTS:
            yield Row(f"  {what}", str(each[what]), "0", not each[what])
    total = sum(each[what] for each in found.values() for what in COUNTED)
    yield Row("calibrations: blows in all", f"{total}", f"{goal}", total >= goal)


def _blow(rounds: Rounds, number: int) -> Counter[str]:
    """The round of a number: one of three is a write that fails, the others are kills."""
    chance = random.Random(number)
    how = chance.choice(ERRORS) if number % 3 == 2 else "SIGKILL"
    last = rounds.moments["SIGKILL" if how == "SIGKILL" else "ENOSPC"]
    first = max(1, last - END) if chance.random() < 0.5 else 1
    return rounds.play(chance.randrange(first, last + 1), how, chance)
