"""Kills, interrupts and resumes over the served wire: is any point that of another sample, lost, or silently missing?

Resumable: each round goes to `served-kills-VERSION.jsonl` in `$PALPATE_CAMPAIGN` (`campaigns`), VERSION being that of
the code; a command that is given again goes on from there. `$PALPATE_BLOWS` says how many there shall be.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.row import Row
from tests.served_kills import FAULTS, rounds

BLOWS = 1000
COUNTED = ("killed", "interrupted", "resumed")
ROOT = Path(__file__).parents[2]


def measure() -> Iterator[Row]:
    """Each figure over all rounds so far."""
    goal = int(os.environ.get("PALPATE_BLOWS", BLOWS))
    file = Path(os.environ.get("PALPATE_CAMPAIGN", "campaigns")) / f"served-kills-{_version()}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    done = _read(file)
    found = sum(done, Counter[str]())
    with tempfile.TemporaryDirectory() as folder, rounds(Path(folder)) as played, file.open("a") as out:
        while sum(found[what] for what in COUNTED) < goal:
            each = played.play(len(done))
            done.append(each)
            found += each
            print(json.dumps(each), file=out, flush=True)
    blows = sum(found[what] for what in COUNTED)
    said = ", ".join(f"{found[what]} {what}" for what in COUNTED)
    yield Row("served wire: kills, interrupts and resumes", f"{blows} ({said})", f"{goal}", blows >= goal)
    yield Row("  points looked at; runs begun anew", f"{found['points looked at']}; {found['begun anew']}")
    yield Row("  samples exchanged by others; of them run stopped", f"{found['meddled with']}; {found['noticed']}")
    for what in FAULTS:
        yield Row(f"  {what}", str(found[what]), "0", not found[what])


def _read(file: Path) -> list[Counter[str]]:
    if not file.exists():
        return []
    return [Counter(json.loads(line)) for line in file.read_text().splitlines() if line.endswith("}")]


def _version() -> str:
    """A hash of all code that is tried."""
    digest = hashlib.sha256()
    for folder in ("drivers", "instrument", "procedures", "simulators"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]
