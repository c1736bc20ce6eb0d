"""Records: what they cost, and what is lost of them by kills, damages, and disks that fail."""

from __future__ import annotations

import errno
import os
import random
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock
from unittest.mock import patch

import numpy as np

import palpate
from palpate.instrument.errors import RecordError
from palpate.procedures.records.chain import RECORD, is_run
from palpate.procedures.records.damage import check
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.record_file import as_json
from palpate.procedures.records.run import Run
from tests import kills as killed
from tests.benchmarks.common import HEADER, Campaign, Row, at_least, at_most, interleaved, none, version_of
from tests.damages import BAD, VICTIMS
from tests.damages import damages as damaging
from tests.kills import Commands
from tests.runs import NIGHTLY

CODE = tuple(f"{folder}/**/*.py" for folder in ("drivers", "instrument", "procedures", "simulators"))
MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
LONGEST = 0.1  # s of the wall, from the wait at which a kill is decided to the kill


def records() -> Iterator[Row]:
    """What a durable record costs beside the disk's own fsync and write, in turn on the same disk."""
    values = {f"value_{number}": 0.1 * number for number in range(20)}
    point, disk, _ = _beside_the_disk(values, samples=250, rounds=400)
    yield at_most(
        "durable point, 20 values and 2 x 250 samples, above the disk's own write and fsync of its bytes",
        1e6 * (point - disk),
        250,
        "{:.0f} µs",
        f"{1e6 * (point - disk):.0f} of {1e6 * point:.0f} µs",
    )
    point, disk, size = _beside_the_disk({}, samples=2_000_000, rounds=12)
    rate, of_disk = (1e-6 * size / each for each in (point, disk))
    yield at_least(
        "waveforms, durable; the disk's own write and fsync",
        rate,
        100,
        "{:.0f} MB/s",
        f"{rate:.0f}; {of_disk:.0f} MB/s" + ("; the disk itself does not reach the goal" if of_disk < 100 else ""),
    )


def _beside_the_disk(values: Mapping[str, float], samples: int, rounds: int) -> tuple[float, float, int]:
    """Median seconds of a point with two films, of writing its bytes, and how many of these there are."""
    wave = np.sin(20 * np.pi * np.arange(samples) / 250.0).astype(np.float32)
    films = dict.fromkeys(("rigid", "total"), (250.0, wave))
    content = as_json(values).encode() + 2 * wave.tobytes()
    with TemporaryDirectory(dir=Path.cwd()) as store, (Path(store) / "raw").open("ab", buffering=0) as raw:

        def written() -> None:
            rest = memoryview(content)
            while rest:
                rest = rest[raw.write(rest) :]
            os.fsync(raw)

        with Recorder.create(Path(store) / "run", HEADER) as recorder:
            point, disk = interleaved(lambda: recorder.point(values, films, 0), written, rounds)
    return point, disk, len(content)


# --- disks that fail -----------------------------------------------------------------------------------


def disk(drawn: int = 20) -> Iterator[Row]:
    """Each write and sync of a sweep fails, tears or is dropped in turn: is an acknowledged point lost untold?

    The model of failure stands below. Operations that fail do so while the run is recorded; the others are
    played from the list of what was asked of the disk, cut off behind each of its operations, so many times with what
    was not synced drawn.
    """
    from palpate.procedures.commands.root import palpate as command

    with TemporaryDirectory(dir=MEMORY) as name:
        folder = Path(name)
        sweep = ("sweep", "loads", "--quiet", "--samples", "1", "--dwell", "0.2 s", "--out", str(folder / "sweep"))
        command(sweep, standalone_mode=False)
        run = Run.open(folder / "sweep")
        counts = {
            "fails": failing(run, folder),
            "cut off, honest disk": cuts(run, folder, drawn, lying=False),
            "cut off, one sync dropped": cuts(run, folder, drawn, lying=True),
        }
    total = sum(counts.values(), Counter[str]())
    yield Row("writes and syncs of a six-point sweep that fail, tear or are dropped", f"{total.total()} cases")
    for what, count in counts.items():
        yield Row(f"  {what}", ", ".join(f"{n} {came}" for came, n in sorted(count.items())))
    honest = counts["fails"] + counts["cut off, honest disk"]
    yield none("  acknowledged points lost, and no check says so", total["silent"])
    lost = honest["lost and told"] + honest["silent"]
    yield none("  of an honest disk: points lost; whole runs refused", lost, f"{lost}; {honest['told']}")


def failing(run: Run, folder: Path) -> Counter[str]:
    """Each operation fails in turn, with the process that goes on, and with a power cut right behind it."""
    count = Counter[str]()
    for number in range(sum(op.what != "said" for op in recorded(run, folder))):
        failed = Disk(laid(folder / "fails", {}), number)
        said = record(run, failed)
        count[verdict(failed.folder, run, said)] += 1
        left = after_a_cut(failed.operations, -1, None, False)
        count[verdict(laid(folder / "cut", left), run, said)] += 1
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
                count[verdict(laid(folder / "cut", files), run, said)] += 1
    return count


def recorded(run: Run, folder: Path) -> list[Operation]:
    """What recording a run asks of the disk."""
    whole = Disk(laid(folder / "recorded", {}))
    assert record(run, whole) == len(run.points())
    return whole.operations


def laid(place: Path, files: dict[str, bytes]) -> Path:
    """A folder with these files and no others."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    for name, content in files.items():
        (place / name).write_bytes(content)
    return place


# --- damages -------------------------------------------------------------------------------------------

READS = (
    *(f"procedures/records/{name}.py" for name in ("chain", "damage", "record_file")),
    *("procedures/study/run.py", "instrument/config.py", "instrument/calibration/files.py", "drivers/logs/bus_log.py"),
    "tests/damages.py",
)


def damages(goal: int = 1_000_000, block: int = 1000) -> Iterator[Row]:
    """A million damages of what is read back: runs, calibrations, studies, bus logs.

    Resumable: each thousand goes into the campaign. What is bad is kept by its number.
    """
    campaign = Campaign("damages", version_of(*READS))
    with TemporaryDirectory(dir=MEMORY) as folder, damaging(Path(folder)) as damage:

        def some(first: int) -> dict[str, object]:
            came = {number: damage(number) for number in range(first, first + block)}
            found = Counter(f"{victim}: {what}" for victim, whats in came.values() for what in whats)
            return {"found": found, "bad": [n for n, (_, whats) in came.items() if set(whats) & set(BAD)]}

        done = campaign.go_on(some(first) for first in range(block * len(campaign.found), goal, block))
    found = sum((Counter(each["found"]) for each in done), Counter[str]())
    yield at_least("damages of runs, calibrations, studies and bus logs", block * len(done), goal, "{}")
    for victim in VICTIMS:
        of = {what.removeprefix(f"{victim}: "): n for what, n in found.items() if what.startswith(f"{victim}: ")}
        yield Row(f"  {victim}", ", ".join(f"{n} {what}" for what, n in sorted(of.items()) if what not in BAD))
    for what in BAD:
        yield none(f"  {what}", sum(count for name, count in found.items() if name.endswith(f": {what}")))


# --- kills ---------------------------------------------------------------------------------------------

SWEEP = ("sweep", "loads", "--quiet", "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--out")


def kills(wanted: int = 1000, workers: int = 4) -> Iterator[Row]:
    """Random SIGKILLs over small sweeps, each resumed and compared with one that was not interrupted.

    Half of the resumed runs are killed again. Beside each kill the amplifier's output after the watchdog's time is
    looked at, in a bench that nobody speaks to any more.
    """
    # each worker waits for the others' turn most of the time
    with TemporaryDirectory() as store, ThreadPoolExecutor(workers) as pool:
        shares = [(Path(store) / str(worker), random.Random(6 + worker)) for worker in range(workers)]
        counts = sum(pool.map(lambda share: _kill(*share, wanted // workers), shares), Counter[str]())
    yield Row(
        "random SIGKILLs over sweeps, of them in resumed runs", f"{counts['kills']}, {counts['again']}", f"{wanted}"
    )
    yield Row("  that came while the amplifier drove; before the first point", f"{counts['driven']}, {counts['early']}")
    for what in ("acknowledged points lost", "unreadable runs", "resumed runs that differ", "outputs left on"):
        yield none(f"  {what}", counts[what])


def _kill(store: Path, chance: random.Random, wanted: int) -> Counter[str]:
    """What came of so many kills, by name."""
    found = Counter[str]()
    with Commands() as commands:
        ticks = commands.run(*SWEEP, str(store / "whole")).ticks
        whole = Run.open(store / "whole")
        while found["kills"] < wanted:
            folder = store / "cut"
            command: tuple[str, ...] = (*SWEEP, str(folder))
            while found["kills"] < wanted:
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


def campaigns(wanted: int = 100) -> Iterator[Row]:
    """A campaign that is killed at random moments until it is done, compared with one that was not."""
    chance, found = random.Random(5), Counter[str]()
    with TemporaryDirectory() as folder, mock.patch.dict(os.environ, {"PALPATE_STORE": f"{folder}/store"}):
        file, store = Path(folder) / "nightly.toml", Path(folder) / "store"
        file.write_text(NIGHTLY, encoding="utf-8")
        command = ("campaign", str(file), "--quiet", "--out", str(store / "campaigns" / "one"))
        with Commands() as commands:
            ticks = commands.run(*command).ticks
            whole = _digests(store)
            while found["kills"] < wanted:
                shutil.rmtree(store)
                found["campaigns"] += 1
                status = -1
                while status != 0 and found["kills"] < wanted:
                    status = commands.killed(chance.randrange(1, ticks), LONGEST * chance.random(), *command).status
                    found["kills"] += status < 0
                found["campaigns that do not end when asked again"] += commands.run(*command).status != 0
                digests = _digests(store)
                found["with other digests"] += digests != whole
                found["with points lost"] += len(digests) < len(whole)
    yield Row(
        "random SIGKILLs over campaigns of three steps, in so many campaigns",
        f"{found['kills']} in {found['campaigns']}",
        f"{wanted}",
    )
    for what in ("campaigns that do not end when asked again", "with points lost", "with other digests"):
        yield none(f"  {what}", found[what])


def _digests(store: Path) -> dict[str, str]:
    """Digest of the complete runs by procedure."""
    runs = [palpate.read(path.parent) for path in store.glob("*/run.record")]
    return {run.procedure: run.digest() for run in runs if run.status == "complete"}


def served_kills(goal: int = 1000) -> Iterator[Row]:
    """Kills, interrupts and resumes over the served wire: is any point that of another sample, lost, silently missing?

    Resumable: each round goes into the campaign.
    """
    counted = ("killed", "interrupted", "resumed")
    campaign = Campaign("served-kills", version_of(*CODE))

    def blows() -> int:
        return sum(each.get(what, 0) for each in campaign.found for what in counted)

    with TemporaryDirectory() as folder, killed.rounds(Path(folder)) as played:
        campaign.go_on(iter(lambda: played.play(len(campaign.found)) if blows() < goal else None, None))
    found = sum(map(Counter, campaign.found), Counter[str]())
    said = ", ".join(f"{found[what]} {what}" for what in counted)
    yield at_least("served wire: kills, interrupts and resumes", blows(), goal, "{}", f"{blows()} ({said})")
    yield Row("  points looked at; runs begun anew", f"{found['points looked at']}; {found['begun anew']}")
    yield Row("  samples exchanged by others; of them run stopped", f"{found['meddled with']}; {found['noticed']}")
    for what in killed.SERVED_FAULTS:
        yield none(f"  {what}", found[what])


def calibrations(goal: int = 1000, rounds: int = 25) -> Iterator[Row]:
    """Kills at every moment of every procedure that calibrates, and failures of each write: is a calibration lost?

    Resumable: each round goes into the campaign. So many rounds
    with one kind of calibration follow one another, in process and served by turns.
    """
    counted = ("killed", "killed again", "failed writes")
    campaign, kinds = Campaign("calibrations", version_of(*CODE)), tuple(killed.COMMANDS)
    places = {"in process": killed.in_process, "served": killed.served}

    def total(counts: Iterator[Mapping[str, int]]) -> int:
        return sum(each.get(what, 0) for each in counts for what in counted)

    def blows() -> Iterator[tuple[str, Counter[str]]]:
        while total(counts for _, counts in campaign.found) < goal:
            block = len(campaign.found) // rounds
            place, kind = (
                tuple(places)[block % 2],
                kinds[block // 2 % len(kinds)],
            )
            with TemporaryDirectory() as folder, places[place](Path(folder), kind) as played:
                for number in range(len(campaign.found), (block + 1) * rounds):
                    yield place, _blow(played, number)

    campaign.go_on(blows())
    for place in places:
        found = sum((Counter(counts) for where, counts in campaign.found if where == place), Counter[str]())
        yield Row(
            f"calibrations {place}: kills and failed writes", ", ".join(f"{found[what]} {what}" for what in counted)
        )
        yield Row("  then resumed; installed", f"{found['resumed']}; {found['installed']}")
        for what in killed.CALIBRATION_FAULTS:
            yield none(f"  {what}", found[what])
    yield at_least("calibrations: blows in all", total(counts for _, counts in campaign.found), goal, "{}")


def _blow(rounds: killed.Calibrations, number: int) -> Counter[str]:
    """The round of a number: one of three is a write that fails, the others are kills.

    A half of the moments lie at the end of a run, where it measures no more and keeps what it has found.
    """
    chance = random.Random(number)
    how = chance.choice(killed.ERRORS) if number % 3 == 2 else "SIGKILL"
    last = rounds.moments["SIGKILL" if how == "SIGKILL" else "ENOSPC"]
    first = max(1, last - 60) if chance.random() < 0.5 else 1
    return rounds.play(chance.randrange(first, last + 1), how, chance)


# --- a disk whose operations are written down --------------------------------------------------------

# The model: a file's content is durable up to its last sync. Of what was written since, any part may be there after a
# power cut, sector by sector; a file that was made longer reads as zeros where nothing came. Names are durable once
# their folder was synced; until then each renaming or making of a file may be there or not, in their order. A sync that
# the disk only pretends to have done makes nothing durable.

SECTOR = 512
Call = Callable[..., Any]


@dataclass(frozen=True, slots=True)
class Operation:
    """What was asked of the disk: "make", "write", "truncate", "rename", "remove", "sync", or "said": of points."""

    what: str
    name: str = ""
    at: int = 0
    content: bytes = b""
    to: str = ""


@dataclass(slots=True)
class Disk:
    """Listens to all that is asked of files in a folder; the operation with the number `fails` fails."""

    folder: Path
    fails: int = -1
    operations: list[Operation] = field(default_factory=list)
    _count: int = 0

    @contextmanager
    def listening(self) -> Iterator[None]:
        asked: dict[str, Callable[..., Sequence[Any]]] = {
            "ftruncate": lambda handle, size: ("truncate", _path(handle), size),
            "fdatasync": lambda handle: ("sync", _path(handle)),
            "fsync": lambda handle: ("sync", _path(handle)),
            "replace": lambda one, other: ("rename", one, 0, b"", Path(other).name),
            "unlink": lambda path, **_: ("remove", path),
        }
        with ExitStack() as stack:
            for name, what in asked.items():
                stack.enter_context(patch.object(os, name, self._telling(getattr(os, name), what)))
            stack.enter_context(patch.object(os, "pwrite", self._pwrite(os.pwrite)))
            make = self._telling(Path.write_bytes, lambda path, content: ("make", path, 0, content))
            stack.enter_context(patch.object(Path, "write_bytes", make))
            yield

    def said(self, points: int) -> None:
        """Notes that so many points were acknowledged by now."""
        self.operations.append(Operation("said", at=points))

    def _asked(self, what: str, path: str | Path, at: int = 0, content: bytes = b"", to: str = "") -> None:
        if Path(path).parent != self.folder and Path(path) != self.folder:
            return
        self._count += 1
        if self._count - 1 == self.fails:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        name = "" if Path(path) == self.folder else Path(path).name
        self.operations.append(Operation(what, name, at, content, to))

    def _pwrite(self, call: Call) -> Call:
        def pwrite(handle: int, content: Any, at: int) -> int:
            try:
                self._asked("write", _path(handle), at, bytes(content))
            except OSError:  # half of it comes through
                call(handle, memoryview(content)[: len(content) // 2], at)
                raise
            return int(call(handle, content, at))

        return pwrite

    def _telling(self, call: Call, what: Callable[..., Sequence[Any]]) -> Call:
        def told(*given: Any, **options: Any) -> Any:
            self._asked(*what(*given, **options))
            return call(*given, **options)

        return told


def _path(handle: int) -> Path:
    return Path(f"/proc/self/fd/{handle}").readlink()


# --- what is there after a power cut -------------------------------------------------------------------


def after_a_cut(
    operations: Sequence[Operation], lies: int, chance: random.Random | None, kept: bool
) -> dict[str, bytes]:
    """The files after a power cut behind these operations.

    Args:
        lies: number of the sync that the disk only pretends to have done; -1: none.
        chance: draws what of that which was not synced is there; None: all of it, or nothing.
        kept: all, where nothing is drawn.
    """
    durable: dict[int, bytes] = {}  # by file
    pending: dict[int, list[Operation]] = {}
    names: dict[str, int] = {}
    seen: dict[str, int] = {}  # names as the program sees them
    changes: list[Callable[[dict[str, int]], object]] = []
    for number, op in enumerate(operations):
        match op.what:
            case "make":
                seen[op.name] = made = len(durable)
                durable[made] = b""
                pending[made] = [Operation("write", at=0, content=op.content)]
                changes.append(lambda there, name=op.name, made=made: there.__setitem__(name, made))
            case "write" | "truncate":
                pending[seen[op.name]].append(op)
            case "rename":
                seen[op.to] = seen.pop(op.name)
                changes.append(lambda there, op=op: op.name in there and there.__setitem__(op.to, there.pop(op.name)))
            case "remove":
                seen.pop(op.name, None)
                changes.append(lambda there, op=op: there.pop(op.name, None))
            case "sync" if number != lies:
                if op.name:
                    file = seen[op.name]
                    durable[file] = _content(durable[file], pending[file], None, True)
                    pending[file] = []
                else:
                    for change in changes:
                        change(names)
                    changes = []
    there = len(changes) if chance is None and kept else chance.randrange(len(changes) + 1) if chance else 0
    for change in changes[:there]:
        change(names)
    return {name: _content(durable[file], pending[file], chance, kept) for name, file in names.items()}


def _content(durable: bytes, pending: list[Operation], chance: random.Random | None, kept: bool) -> bytes:
    content = bytearray(durable)
    for op in pending:
        if chance is None and not kept:
            continue
        if op.what == "truncate":
            if chance is None or chance.random() < 0.5:
                del content[op.at :]
            continue
        how = chance.random() if chance else 0.0
        if how < 0.4:
            _put(content, op.at, op.content)
        elif how < 0.8:
            # a sector is there or not; where the first ends is up to the place in the file
            at = 0
            while at < len(op.content):
                size = SECTOR - (op.at + at) % SECTOR
                if chance is not None and chance.random() < 0.5:
                    _put(content, op.at + at, op.content[at : at + size])
                at += size
    return bytes(content)


def _put(content: bytearray, at: int, part: bytes) -> None:
    content.extend(bytes(max(0, at - len(content))))
    content[at : at + len(part)] = part


# --- a run on it ----------------------------------------------------------------------------------------


def record(run: Run, disk: Disk) -> int:
    """Records a run once more, as its procedure did, on that disk; how many points were acknowledged."""
    films = {point["id"]: {} for point in run.points()}
    for waveform in run.waveforms():
        films[waveform.point_id][waveform.name] = (waveform.rate, waveform.samples)
    said = 0
    with suppress(RecordError), disk.listening():
        disk.said(0)
        with Recorder.create(disk.folder, run.header) as recorder:
            for point in run.points():
                data = {key: value for key, value in point.items() if key not in ("id", "bench_ns")}
                recorder.point(data, films[point["id"]], point["bench_ns"])
                said = recorder.points
                disk.said(said)
                if said % 2 == 0:
                    recorder.event("note", f"after point {said}", point["bench_ns"])
            recorder.finish("complete", run.summary)
    return said


def verdict(folder: Path, run: Run, said: int) -> str:
    """What came of so many acknowledged points of a run: "kept", "lost and told", "told" (none is lost), "silent"."""
    faults = check(folder).faults if said or is_run(folder) else []  # a run that is not there is missed
    try:
        left = Run.open(folder).points() if is_run(folder) else []
    except RecordError:
        left = []
    whole = left[:said] == run.points()[:said] and left == run.points()[: len(left)]
    if whole:
        return "told" if faults else "kept"
    return "lost and told" if faults else "silent"
