"""Random scenes with random parameters: does an effect change a result by more than its bound, and how wide are bounds?

Resumable: results go to `bounds-VERSION.jsonl` in `$PALPATE_CAMPAIGN` (`campaigns`), and a command that is given again
goes on from there. VERSION is that of the modules that trials import, and of no others: drivers, procedures, devices
on their buses may change while a campaign goes on. `$PALPATE_SCENES` says how many scenes, `$PALPATE_WORKERS` how many
processes.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import signal
import subprocess
import sys
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType

import numpy as np

from palpate.instrument.errors import PalpateError
from palpate.simulators.bounds import bound_of
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.planning.plan import case_of
from tests.benchmarks.lines import read
from tests.benchmarks.row import Row
from tests.simulators.measured import changes
from tests.simulators.random_scenes import drawn

SCENES = 100_000
# Draws of the drive's phase, fewer where each takes long, and of the seed in each. A bound's width is against the
# greatest change of them all, and is looked at in the first scenes alone: the others have `FEWER` of both.
PHASES, FEWER, SEEDS = 5, 2, 3
FULLY = 10_000
ROUNDING = 1e-10  # of two results that agree to this, the bound may well be 0
SMALLEST = 1e-9  # of a bound whose width counts, and of a change that it is compared with
WIDE, VERY_WIDE, GOAL = 10.0, 100.0, 0.9
QUANTILES = (0.1, 0.5, 0.9, 0.99)
BATCH = 20
LIMIT = 5.0  # s of processor for a scene; a few in a thousand, whose contact is lost and creeps, would take hours
FIRST = 40  # trials, after which all modules that any needs are imported
PACKAGES = ("instrument", "drivers", "simulators", "procedures", "tests")
ROOT = Path(__file__).parents[2]


NOTHING: list[float | None] = [None, None]


class TooLong(PalpateError):
    """A scene takes more than `LIMIT`."""


@dataclass(frozen=True)
class Tried:
    """One scene.

    bounds: of force and ratio; None: none is given. greatest, first: changes, of all draws and of the scene as drawn;
    None: nothing to compare. refused: why the scene could not be followed. long: it was given up after `LIMIT`.
    crash: an error that is none of ours.
    """

    number: int
    name: str
    beside: list[str]
    bounds: list[float | None]
    greatest: list[float | None]
    first: list[float | None]
    refused: str = ""
    long: bool = False
    crash: str = ""

    def broken(self) -> bool:
        pairs = zip(self.bounds, self.greatest, strict=True)
        return any(b is not None and c is not None and c > b + ROUNDING for b, c in pairs)


def _too_long(_signal: int, _frame: FrameType | None) -> None:
    raise TooLong(f"no end after {LIMIT:g} s")


def tried(number: int) -> Tried:
    """What the bound of a random scene says, and what comes of it."""
    before = signal.signal(signal.SIGVTALRM, _too_long)
    signal.setitimer(signal.ITIMER_VIRTUAL, LIMIT)
    try:
        return _tried(number)
    except Exception as error:  # a crash is a figure, too, and the campaign goes on
        return Tried(number, drawn(number).name, [], NOTHING, NOTHING, NOTHING, crash=repr(error)[:200])
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def _tried(number: int) -> Tried:
    chosen = drawn(number)
    scene, effect = chosen.without, chosen.with_it.effects[chosen.name]
    try:
        case = case_of(scene.design, scene.model, scene.effects, chosen.question, scene.rig)
        bound = bound_of(case, effect)
        given = math.isfinite(bound.force) or math.isfinite(bound.ratio)
        long = {"hysteresis", "humidity_leak"} & set(chosen.with_it.effects)
        # Without a bound one draw tells whether there is anything to compare.
        draws = (FEWER if long else PHASES, SEEDS) if number < FULLY else (FEWER, FEWER)
        draws = draws if given else (1, 1)
        found = changes(scene, chosen.with_it, chosen.question, *draws)
    except PalpateError as error:
        long = isinstance(error, TooLong)
        return Tried(number, chosen.name, list(scene.effects), NOTHING, NOTHING, NOTHING, str(error)[:200], long)
    bounds = [value if math.isfinite(value) else None for value in (bound.force, bound.ratio)]
    if not found:
        return Tried(number, chosen.name, list(scene.effects), bounds, NOTHING, NOTHING)
    greatest = np.array(found).max(axis=0).tolist()
    return Tried(number, chosen.name, list(scene.effects), bounds, greatest, list(found[0]))


def _batch(numbers: Sequence[int]) -> list[Tried]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of scenes of which nothing finite comes
        return [tried(number) for number in numbers]


# --- the state on disk ---------------------------------------------------------------------------------


def measure() -> Iterator[Row]:
    goal = int(os.environ.get("PALPATE_SCENES", SCENES))
    file = Path(os.environ.get("PALPATE_CAMPAIGN", "campaigns")) / f"bounds-{_version()}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    known = {each.number: each for each in read(file, Tried)}
    missing = [number for number in range(goal) if number not in known]
    try:
        with file.open("a", encoding="utf-8") as out:
            for batch in _batches(missing):
                for each in batch:
                    known[each.number] = each
                    out.write(json.dumps(asdict(each)) + "\n")
                out.flush()
    except KeyboardInterrupt:
        print(f"{len(known)} of {goal} scenes; give the command again to go on", file=sys.stderr)  # noqa: T201
    yield from rows([known[number] for number in sorted(known)], goal)


def _batches(numbers: Sequence[int]) -> Iterator[list[Tried]]:
    batches = [numbers[first : first + BATCH] for first in range(0, len(numbers), BATCH)]
    workers = int(os.environ.get("PALPATE_WORKERS", "1"))
    if workers == 1:
        yield from map(_batch, batches)
    else:
        with ProcessPoolExecutor(workers) as pool:
            yield from pool.map(_batch, batches)


def _version() -> str:
    """Of what decides bounds and scenes."""
    digest = hashlib.sha256()
    for path in sources():
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def sources() -> list[Path]:
    """Of the project's modules that trials import. Asked in a fresh interpreter: this one may have imported more."""
    ask = [sys.executable, "-c", "from tests.benchmarks import bounds; print(*bounds.imported(), sep='\\n')"]
    told = subprocess.run(ask, cwd=ROOT, check=True, capture_output=True, text=True)
    return [ROOT / line for line in told.stdout.splitlines()]


def imported() -> list[str]:
    """Files of the project, from its root, that are imported by now, after the first trials and with every effect."""
    for name in EFFECTS:
        effect_class(name)
    _batch(range(FIRST))
    files = [Path(each.__file__).resolve() for each in list(sys.modules.values()) if getattr(each, "__file__", None)]
    own = [each.relative_to(ROOT) for each in files if each.is_relative_to(ROOT)]
    return sorted(str(each) for each in own if each.parts[0] in PACKAGES)


# --- figures -------------------------------------------------------------------------------------------


def rows(results: Sequence[Tried], goal: int) -> Iterator[Row]:
    """The figures of some scenes."""
    broken = [each for each in results if each.broken()]
    yield Row("random scenes", f"{len(results)}", f"{goal}", len(results) >= goal)
    yield Row("  broken bounds", _listed(broken), "0", not broken)
    crashed = [each for each in results if each.crash]
    yield Row("  that crash", _listed(crashed), "0", not crashed)
    yield Row("  that nothing can follow", _listed([each for each in results if each.refused and not each.long]))
    yield Row(f"  given up after {LIMIT:g} s of processor", _listed([each for each in results if each.long]))
    results = [each for each in results if each.number < FULLY]
    for which, told in (("greatest", "the greatest change of some draws"), ("first", "one draw alone")):
        widths = _widths(results, which)
        given = [width for width in widths if math.isfinite(width)]
        yield Row(f"  bounds that are compared with {told}; none given", f"{len(given)}; {len(widths) - len(given)}")
        if not given:
            continue
        share = sum(width <= WIDE for width in given) / len(given)
        met = share >= GOAL if which == "greatest" else None  # one draw of noise may be anywhere below a bound
        yield Row("    10, 50, 90, 99 % are wider by", " ".join(f"{w:.3g}" for w in np.quantile(given, QUANTILES)))
        wide = f"{100 * share:.1f} %, {sum(width > VERY_WIDE for width in given)}"
        yield Row(f"    at most {WIDE:g} times, above {VERY_WIDE:g} times", wide, "" if met is None else ">= 90 %", met)


def _widths(results: Iterable[Tried], which: str) -> list[float]:
    """Bounds over changes; infinite where none is given."""
    widths = []
    for each in results:
        for bound, change in zip(each.bounds, getattr(each, which), strict=True):
            if change is not None and (bound is None or bound > SMALLEST):
                widths.append(math.inf if bound is None else bound / max(change, SMALLEST))
    return widths


def _listed(some: Sequence[Tried]) -> str:
    names = Counter(each.name for each in some)
    listed = ", ".join(f"{name} {count}" for name, count in names.most_common(4))
    return f"{len(some)}" + (f" ({listed}; first {some[0].number})" if some else "")
