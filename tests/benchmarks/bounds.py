"""Random scenes with random parameters, and the bounds of effects in them. It imports what its trials need, no more."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from operator import attrgetter
from pathlib import Path
from types import FrameType

import numpy as np

from palpate.instrument.errors import PalpateError
from palpate.simulators.bounds import bound_of
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.planning.plan import case_of
from tests.benchmarks.common import ROOT, Campaign, Row, at_least, none, version_of
from tests.simulators.measured import changes
from tests.simulators.random_scenes import drawn

# Draws of the drive's phase, fewer where each takes long, and of the seed in each. A bound's width is against the
# greatest change of them all, and is looked at in the first scenes alone: the others have `FEWER` of both.
PHASES, FEWER, SEEDS = 5, 2, 3
FULLY = 10_000
ROUNDING = 1e-10  # of two results that agree to this, the bound may well be 0
SMALLEST = 1e-9  # of a bound whose width counts, and of a change that it is compared with
BATCH = 20
LIMIT = 5.0  # s of processor for a scene; a few in a thousand, whose contact is lost and creeps, would take hours
FIRST = 40  # trials, after which all modules that any needs are imported
PACKAGES = ("instrument", "drivers", "simulators", "procedures", "tests")
NOTHING: list[float | None] = [None, None]


class TooLong(PalpateError):
    """A scene takes more than `LIMIT`."""


@dataclass(frozen=True)
class Tried:
    """One scene.

    bounds: of force and ratio; None: none is given. greatest: changes of all draws; None: nothing to compare.
    refused: why the scene could not be followed. long: it was given up after `LIMIT`. crash: an error that is none of
    ours.
    """

    number: int
    name: str
    beside: list[str]
    bounds: list[float | None]
    greatest: list[float | None]
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
        return Tried(number, drawn(number).name, [], NOTHING, NOTHING, crash=repr(error)[:200])
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
        return Tried(number, chosen.name, list(scene.effects), NOTHING, NOTHING, str(error)[:200], long)
    bounds = [value if math.isfinite(value) else None for value in (bound.force, bound.ratio)]
    greatest = np.array(found).max(axis=0).tolist() if found else NOTHING
    return Tried(number, chosen.name, list(scene.effects), bounds, greatest)


def _batch(numbers: Sequence[int]) -> list[Tried]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of scenes of which nothing finite comes
        return [tried(number) for number in numbers]


# --- the state on disk ---------------------------------------------------------------------------------


def bounds(scenes: int = 100_000, workers: int = 1) -> Iterator[Row]:
    """Random scenes with random parameters: does an effect change a result by more than its bound, how wide are bounds?

    Resumable: results go into a campaign, whose version is that of the modules that trials import, and of no others:
    drivers, procedures, devices on their buses may change while a campaign goes on.
    """
    campaign = Campaign("bounds", version_of(*(file.relative_to(ROOT) for file in sources())))
    known = {number for batch in campaign.found for number in (each["number"] for each in batch)}
    missing = [number for number in range(scenes) if number not in known]
    with ProcessPoolExecutor(workers) as pool:
        batches = pool.map(_batch, (missing[first : first + BATCH] for first in range(0, len(missing), BATCH)))
        found = campaign.go_on([asdict(each) for each in batch] for batch in batches)
    yield from rows([Tried(**each) for batch in found for each in batch], scenes)


def sources() -> list[Path]:
    """Of the project's modules that trials import. Asked in a fresh interpreter: this one may have imported more."""
    ask = [sys.executable, "-c", "from tests.benchmarks import bounds; print(*bounds.imported(), sep='\\n')"]
    told = subprocess.run(ask, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [ROOT / line for line in told.splitlines()]


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
    yield at_least("random scenes", len(results), goal, "{}")
    for what, wrong in (("broken bounds", Tried.broken), ("that crash", attrgetter("crash"))):
        some = [each for each in results if wrong(each)]
        yield none(f"  {what}", len(some), _listed(some))
    yield Row("  that nothing can follow", _listed([each for each in results if each.refused and not each.long]))
    yield Row(f"  given up after {LIMIT:g} s of processor", _listed([each for each in results if each.long]))
    widths = [  # bounds over changes; infinite where none is given
        math.inf if bound is None else bound / max(change, SMALLEST)
        for each in results
        for bound, change in zip(each.bounds, each.greatest, strict=True)
        if each.number < FULLY and change is not None and (bound is None or bound > SMALLEST)
    ]
    given = [width for width in widths if math.isfinite(width)]
    yield Row("  bounds that are compared with a change; none given", f"{len(given)}; {len(widths) - len(given)}")
    if given:
        yield Row(
            "    10, 50, 90, 99 % are wider by",
            " ".join(f"{width:.3g}" for width in np.quantile(given, (0.1, 0.5, 0.9, 0.99))),
        )
        share = sum(width <= 10 for width in given) / len(given)
        wide = f"{100 * share:.1f} %, {sum(width > 100 for width in given)}"
        yield at_least("    at most 10 times, above 100 times", share, 0.9, "{:.0%}", wide)


def _listed(some: Sequence[Tried]) -> str:
    names = Counter(each.name for each in some)
    listed = ", ".join(f"{name} {count}" for name, count in names.most_common(4))
    return f"{len(some)}" + (f" ({listed}; first {some[0].number})" if some else "")
