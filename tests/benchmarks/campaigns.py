"""A campaign that is killed at random moments, again and again, until it is done; compared with one that was not."""

from __future__ import annotations

import os
import random
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import palpate
from tests.benchmarks.row import Row
from tests.campaigns import NIGHTLY
from tests.kills import Commands

KILLS = 100
SEED = 5
LONGEST = 0.1  # s of the wall, from the wait at which a kill is decided to the kill


def measure() -> Iterator[Row]:
    chance = random.Random(SEED)
    kills = campaigns = other = unfinished = lost = 0
    before = os.environ.get("PALPATE_STORE")
    with tempfile.TemporaryDirectory() as folder:
        file, store = Path(folder) / "nightly.toml", Path(folder) / "store"
        file.write_text(NIGHTLY, encoding="utf-8")
        os.environ["PALPATE_STORE"] = str(store)
        command = ("campaign", str(file), "--quiet", "--out", str(store / "campaigns" / "one"))
        try:
            with Commands() as commands:
                ticks = commands.run(*command).ticks
                whole = _digests(store)
                while kills < KILLS:
                    shutil.rmtree(store)
                    campaigns += 1
                    status = -1
                    while status != 0 and kills < KILLS:
                        end = commands.killed(chance.randrange(1, ticks), LONGEST * chance.random(), *command)
                        status, kills = end.status, kills + (end.status < 0)
                    unfinished += commands.run(*command).status != 0
                    found = _digests(store)
                    other += found != whole
                    lost += len(found) < len(whole)
        finally:
            os.environ.pop("PALPATE_STORE")
            if before is not None:
                os.environ["PALPATE_STORE"] = before
    yield Row("random SIGKILLs over campaigns of three steps, in so many campaigns", f"{kills} in {campaigns}")
    for what, count in (
        ("campaigns that do not end when asked again", unfinished),
        ("with points lost", lost),
        ("with other digests", other),
    ):
        yield Row(f"  {what}", str(count), "0", not count)


def _digests(store: Path) -> dict[str, str]:
    """Digest of the complete runs by procedure."""
    runs = [palpate.read(path.parent) for path in store.glob("*/run.record")]
    return {run.procedure: run.digest() for run in runs if run.status == "complete"}
