"""Each write and sync of a six-point sweep fails, is torn or is dropped in turn: is an acknowledged point lost untold?

`tests/disk.py` has the model of failure. Operations that fail do so while the run is recorded; the others are played
from the list of what was asked of the disk, cut off behind each of its operations.
"""

from __future__ import annotations

import os
import random
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from palpate.procedures.records.run import Run
from tests.benchmarks.row import Row
from tests.disk import Disk, Operation, after_a_cut, record, verdict

SWEEP = ("sweep", "loads", "--quiet", "--samples", "1", "--dwell", "0.2 s", "--out")
DRAWN = int(os.environ.get("PALPATE_CUTS", "20"))  # of each power cut, what of that which was not synced is there


def measure() -> Iterator[Row]:
    from palpate.procedures.commands.root import palpate

    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as name:
        folder = Path(name)
        palpate([*SWEEP, str(folder / "sweep")], standalone_mode=False)
        run = Run.open(folder / "sweep")
        counts = {
            "fails": failing(run, folder),
            "cut off, honest disk": cuts(run, folder, DRAWN, lying=False),
            "cut off, one sync dropped": cuts(run, folder, DRAWN, lying=True),
        }
    total = sum(counts.values(), Counter[str]())
    yield Row("writes and syncs of a six-point sweep that fail, tear or are dropped", f"{total.total()} cases")
    for what, count in counts.items():
        yield Row(f"  {what}", ", ".join(f"{n} {came}" for came, n in sorted(count.items())))
    honest = counts["fails"] + counts["cut off, honest disk"]
    yield Row("  acknowledged points lost, and no check says so", str(total["silent"]), "0", not total["silent"])
    lost = honest["lost and told"] + honest["silent"]
    yield Row("  of an honest disk: points lost; whole runs refused", f"{lost}; {honest['told']}", "0; 0", not lost)


def failing(run: Run, folder: Path) -> Counter[str]:
    """Each operation fails in turn, with the process that goes on, and with a power cut right behind it."""
    count = Counter[str]()
    for number in range(sum(op.what != "said" for op in recorded(run, folder))):
        disk = Disk(folder / "fails", number)
        shutil.rmtree(disk.folder, ignore_errors=True)
        disk.folder.mkdir()
        said = record(run, disk)
        count[verdict(disk.folder, run, said)] += 1
        count[verdict(laid(folder, after_a_cut(disk.operations, -1, None, False)), run, said)] += 1
    return count


def cuts(run: Run, folder: Path, drawn: int, *, lying: bool) -> Counter[str]:
    """The power is cut behind each operation."""
    count = Counter[str]()
    operations = recorded(run, folder)
    syncs = [n for n, op in enumerate(operations) if op.what == "sync"] if lying else [-1]
    for lie in syncs:
        for cut in range(max(lie, 0), len(operations) + 1):
            done = operations[:cut]
            said = max([op.at for op in done if op.what == "said"], default=0)
            for draw in range(-2, drawn if not lying else drawn // 10):
                chance = random.Random(f"{lie} {cut} {draw}") if draw >= 0 else None
                files = after_a_cut(done, lie, chance, kept=draw == -1)
                count[verdict(laid(folder, files), run, said)] += 1
    return count


def recorded(run: Run, folder: Path) -> list[Operation]:
    """What recording a run asks of the disk."""
    disk = Disk(folder / "recorded")
    shutil.rmtree(disk.folder, ignore_errors=True)
    disk.folder.mkdir()
    assert record(run, disk) == len(run.points())
    return disk.operations


def laid(folder: Path, files: dict[str, bytes]) -> Path:
    """A folder with these files."""
    place = folder / "cut"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    for name, content in files.items():
        (place / name).write_bytes(content)
    return place
