"""A million damages of what is read back: runs, calibrations, studies, bus logs.

Resumable: each thousand goes to `damages-VERSION.jsonl` in `$PALPATE_CAMPAIGN` (`campaigns`), VERSION being that of the
code; a command that is given again goes on from there. `$PALPATE_DAMAGES` says how many; `$PALPATE_SHARE` (as 0/2)
which of several processes this is. `python -m tests.benchmarks.damages NUMBER` does one of them again.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.row import Row
from tests.damages import BAD, VICTIMS, damages

DAMAGES = 1_000_000
BLOCK = 1000
ROOT = Path(__file__).parents[2]
TRIED = (
    *(f"procedures/records/{name}.py" for name in ("chain", "damage", "record_file")),
    *("procedures/study/run.py", "instrument/config.py", "instrument/calibration/files.py", "drivers/logs/bus_log.py"),
    "tests/damages.py",
)


def measure() -> Iterator[Row]:
    """Each figure over all damages so far."""
    goal = int(os.environ.get("PALPATE_DAMAGES", DAMAGES))
    share, _, shares = os.environ.get("PALPATE_SHARE", "0/1").partition("/")
    file = Path(os.environ.get("PALPATE_CAMPAIGN", "campaigns")) / f"damages-{_version()}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    done = _read(file)
    with tempfile.TemporaryDirectory(dir=_memory()) as folder, damages(Path(folder)) as damage, file.open("a") as out:
        for block in range(int(share), -(-goal // BLOCK), int(shares)):
            if block not in done:
                found, bad = Counter[str](), []
                for number in range(BLOCK * block, BLOCK * (block + 1)):
                    victim, came = damage(number)
                    found.update(f"{victim}: {what}" for what in came)
                    bad += [[number, victim, *came]] * any(what in BAD for what in came)
                done[block] = found
                print(json.dumps({"block": block, "found": found, "bad": bad}), file=out, flush=True)
    found = sum(_read(file).values(), Counter[str]())
    tried = BLOCK * len(done)
    yield Row("damages of runs, calibrations, studies and bus logs", f"{tried}", f"{goal}", tried >= goal)
    for victim in VICTIMS:
        of = {what.partition(": ")[2]: count for what, count in found.items() if what.partition(": ")[0] == victim}
        harmless = ", ".join(f"{count} {what}" for what, count in sorted(of.items()) if what not in BAD)
        yield Row(f"  {victim}", harmless)
    for what in BAD:
        count = sum(count for name, count in found.items() if name.endswith(f": {what}"))
        yield Row(f"  {what}", str(count), "0", not count)


def _memory() -> str | None:
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


def _read(file: Path) -> dict[int, Counter[str]]:
    if not file.exists():
        return {}
    lines = [json.loads(line) for line in file.read_text().splitlines() if line.endswith("}")]
    return {line["block"]: Counter(line["found"]) for line in lines}


def _version() -> str:
    """A hash of the code that reads damaged runs."""
    digest = hashlib.sha256()
    for name in TRIED:
        digest.update((ROOT / name).read_bytes())
    return digest.hexdigest()[:12]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(dir=_memory()) as place, damages(Path(place)) as one:
        for number in map(int, sys.argv[1:]):
            print(number, *one(number))  # noqa: T201
