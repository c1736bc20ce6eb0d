"""Prices of dwells: uncertainty and bias of a force ratio by each estimator, for dwells cut from a long record.

The record is cut into pieces of each dwell. The spread of their ratios is the uncertainty, and the error of their mean
is the bias. They are compared with the Cramér–Rao bound for the noise around the drive, and with the floor that does
not fall with the dwell: the scatter of the gains from one load set to the next, and everything that moves in step with
the drive.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from palpate.instrument.allocation.allocate import BelowFloor, allocate
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.errors import EstimateError, RangeError, UnknownName
from palpate.instrument.signals.dwell import Floor, check_dwell, floor_u, ratio_noise
from palpate.instrument.signals.estimate import (
    ESTIMATORS,
    LEAST_SQUARES,
    Floats,
    SineFit,
    amplitude_ratio,
    amplitude_ratios,
    fit_sine,
    ratio_bound,
)
from palpate.instrument.signals.sine_columns import sine_columns
from palpate.procedures.measurements.object_modulus.prospect import costs_of
from palpate.procedures.showing.figure import MARKERS, new_figure, save_in_new
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.text import new_table, print_all, stamped

DWELLS = (0.1, 0.2, 0.4, 1.0, 2.0, 4.0, 10.0)  # s
TARGETS = (0.1, 0.01, 1e-3, 1e-4)  # relative standard uncertainty of the ratio
FEWEST = 10  # pieces of a record; they tell the spread to a quarter of itself
MOST = 1000
LOAD = 1.0  # N; the time between load sets is the same for all
REMEDY = "tie the films' cables down, or shield them"
ROUND_OFF = 1e-12  # relative
SURE = 2.0  # standard uncertainties; a smaller bias does not show
COHERENT, SCATTER, NOISE = "in step with the drive", "gain scatter", "noise"


class TwoFilmRecord(Protocol):
    """Record of two films under a settled load, with the true ratio; see `palpate.simulators.planning.waveforms`."""

    @property
    def time(self) -> Floats: ...
    @property
    def voltage(self) -> Floats: ...
    @property
    def saturated(self) -> bool: ...
    @property
    def ratio(self) -> float: ...
    @property
    def scatter(self) -> float: ...


@dataclass(frozen=True, slots=True)
class EstimatorPoint:
    """One estimator over one dwell. All numbers are relative to the ratio.

    Attributes:
        repeats: number of pieces of the record.
        u, u_u: standard deviation of their ratios, with its standard uncertainty.
        bias, bias_u: bias of their mean, with its standard uncertainty.
        bound: Cramér–Rao bound for the noise around the drive.
        seconds: bench time of one load set, from the one before it on.
        whole_u: standard uncertainty of the ratio of one load set over this dwell: with the noise, the bias, and the
            floor that no dwell lowers.
        efficiency: bound² / u²; None where nothing scatters. It may be above 1 by chance, or because an estimator
            neglects trend and hum.
        hum: greatest voltage that 1 V of mains hum may add to an amplitude by least squares [V]; 0 if hum is fitted.
    """

    estimator: str
    dwell_s: float
    repeats: int
    u: float
    u_u: float
    bias: float
    bias_u: float
    bound: float
    seconds: float
    whole_u: float
    efficiency: float | None
    hum: float


@dataclass(frozen=True, slots=True)
class RecommendedDwell:
    """The quickest way to a target: load sets, each of a dwell.

    Attributes:
        estimator: least squares, if it was asked for.
        sets, dwell_s: number of load sets whose mean is taken, and the dwell of each; None: no such way.
        u: relative standard uncertainty of that mean.
        seconds: bench time after the mounting.
        why: why there is no way; empty where there is one.
    """

    target: float
    estimator: str | None = None
    sets: int | None = None
    dwell_s: float | None = None
    u: float | None = None
    seconds: float | None = None
    why: str = ""


@dataclass(frozen=True, slots=True)
class DwellPrices:
    """Prices of dwells on one scene.

    Attributes:
        floor: relative standard uncertainties that no dwell lowers, by name.
        floor_u: all of them together.
        noise: relative standard uncertainty after one second by noise alone [√s].
        saturated: whether a film was over-ranged, so that no number here holds.
    """

    points: tuple[EstimatorPoint, ...]
    floor: Mapping[str, float]
    floor_u: float
    noise: float
    saturated: bool
    recommended: tuple[RecommendedDwell, ...]

    def summary(self) -> dict[str, Any]:
        """The prices as JSON has them."""
        return asdict(self)


def check(dwells: Sequence[float], estimators: Sequence[str], frequency: float, rate: float, duration: float) -> None:
    """Refuse settings that give no estimate, before anything is simulated.

    Args:
        dwells: dwells [s].
        estimators: names of estimators.
        frequency: frequency of the drive [Hz].
        rate: samples a second.
        duration: duration of the record that will be cut [s].

    Raises:
        RangeError: a dwell is below one cycle or above a tenth of the record, or the frequency is above half the sample
            rate.
        UnknownName: there is no such estimator.
    """
    for name in estimators:
        if name not in ESTIMATORS:
            raise UnknownName("estimator", name, ESTIMATORS)
    for dwell in dwells:
        check_dwell(dwell, frequency, rate)
        if not dwell * FEWEST <= duration * (1 + 1e-9):
            raise RangeError(
                f"dwell {dwell:g} s is above a {FEWEST}th of the record of {duration:g} s: too few repeats to tell a"
                " spread; take a longer record or a shorter dwell"
            )


def measure(
    record: TwoFilmRecord, frequency: float, dwells: Sequence[float], estimators: Sequence[str] = tuple(ESTIMATORS)
) -> DwellPrices:
    """Cut a record up by each dwell, and read each piece by each estimator.

    Raises:
        RangeError, UnknownName: as `check`.
        EstimateError: the record does not determine a ratio.
    """
    rate = 1 / float(record.time[1] - record.time[0])
    check(dwells, estimators, frequency, rate, record.time.size / rate)
    whole = fit_sine(record.time, record.voltage, frequency)
    ratio, u = amplitude_ratio(whole, 0, 1)
    coherent = ratio / record.ratio - 1
    floor = (
        Floor(SCATTER, record.scatter),
        Floor(COHERENT, abs(coherent) if abs(coherent) > SURE * u / ratio else 0.0),
    )
    points = tuple(
        _point(name, record, whole, round(dwell * rate), rate, floor) for dwell in dwells for name in estimators
    )
    judged = [point for point in points if point.estimator == LEAST_SQUARES] or points
    scatter, in_step = (part.u for part in floor)
    return DwellPrices(
        points=points,
        floor={part.name: part.u for part in floor},
        floor_u=floor_u(floor),
        noise=ratio_noise(whole, 0, 1),
        saturated=record.saturated,
        recommended=tuple(_recommend(target, judged, frequency, scatter, in_step) for target in TARGETS),
    )


def _point(
    estimator: str, record: TwoFilmRecord, whole: SineFit, n: int, rate: float, floor: Sequence[Floor]
) -> EstimatorPoint:
    repeats = min(record.time.size // n, MOST)
    time = record.time[:n]
    pieces = record.voltage[:, : repeats * n].reshape(2, repeats, n).swapaxes(0, 1)
    # All pieces use the first one's times, because an amplitude does not depend on the phase at which a piece begins.
    relative = amplitude_ratios(estimator, time, pieces, whole.frequency) / record.ratio
    if not np.isfinite(relative).all():
        raise EstimateError(f"{estimator}: a piece of the record gives no ratio; take a longer dwell")
    u = float(relative.std(ddof=1))
    correlation = float(whole.correlation[0, 1])
    bound = ratio_bound(time, whole.frequency, whole.amplitude[:2], whole.phase[:2], whole.noise[:2], correlation)
    bias = float(relative.mean()) - 1
    scatter, coherent = (part.u for part in floor)
    return EstimatorPoint(
        estimator=estimator,
        dwell_s=n / rate,
        repeats=repeats,
        u=u,
        u_u=u / math.sqrt(2 * (repeats - 1)),
        bias=bias,
        bias_u=u / math.sqrt(repeats),
        bound=bound,
        seconds=costs_of(LOAD, whole.frequency).set + n / rate,
        # What is in step with the drive is a bias of every estimator; one of its own may add to it.
        whole_u=math.hypot(u, scatter, max(abs(bias), coherent)),
        efficiency=(bound / u) ** 2 if u > ROUND_OFF else None,
        hum=sine_columns(time, whole.frequency).hum,
    )


def _recommend(
    target: float, points: Sequence[EstimatorPoint], frequency: float, scatter: float, coherent: float
) -> RecommendedDwell:
    """The quickest number of load sets and dwell, which is one of the priced ones or longer."""
    between = Costs(0.0, 0.0, costs_of(LOAD, frequency).set)
    least, found = math.inf, None
    for point in points:
        bias = max(coherent, abs(point.bias) if abs(point.bias) > SURE * point.bias_u else 0.0)
        noise = point.u * math.sqrt(point.dwell_s)
        lines = [
            BudgetLine(SCATTER, scatter, RepeatUnit.SET),
            BudgetLine(NOISE, noise, RepeatUnit.SECOND),
            BudgetLine(COHERENT, bias, RepeatUnit.NOTHING),
        ]
        try:
            plan = allocate(lines, between, target, shortest=point.dwell_s)
        except BelowFloor as refused:
            least = min(least, refused.floor)
            continue
        if found is None or plan.seconds < (found.seconds or math.inf):
            dwell = max(point.dwell_s, math.ceil(plan.dwell * frequency * (1 - 1e-9)) / frequency)
            u, seconds = budget(lines, 1, plan.sets, dwell).u, between.seconds(1, plan.sets, dwell)
            found = RecommendedDwell(target, point.estimator, plan.sets, dwell, u, seconds)
    if found is not None:
        return found
    why = f"neither dwell nor load sets: what is {COHERENT} leaves {least:.2%}; {REMEDY}"
    return RecommendedDwell(target, why=why)


# --- Prices of dwells: a table of uncertainty and bias by estimator, and a log-log plot of both --------

PLOT = "dwell.png"


def print_dwell(prices: DwellPrices, title: str, plot: Path | None) -> None:
    """Print a line for each dwell: the bound, and each estimator's uncertainty and bias in percent of the ratio."""
    estimators = list(dict.fromkeys(p.estimator for p in prices.points))
    table = new_table(
        stamped(True, title), "dwell s", "repeats", "bound %", *(f"{name}\nu %  bias %" for name in estimators)
    )
    for dwell in dict.fromkeys(p.dwell_s for p in prices.points):
        row = [p for p in prices.points if p.dwell_s == dwell]
        cells = [f"{100 * p.u:.2g} {100 * p.bias:+8.2g}" for p in row]
        table.add_row(f"{dwell:.4g}", str(row[0].repeats), f"{100 * row[0].bound:.3g}", *cells)
    parts = ", ".join(f"{name} {u:.2%}" for name, u in prices.floor.items())
    lines = [
        "bound: the least that noise allows where offset, trend and hum are fitted, too (Cramér–Rao); what takes them"
        " for none may scatter less",
        f"floor that no dwell beats: {prices.floor_u:.2%}: {parts}",
    ]
    mixed = {p.dwell_s: p.hum for p in prices.points if p.hum > 0}
    lines += [
        f"least squares over {d:.4g} s lets {hum:.2g} of the mains' hum into an amplitude" for d, hum in mixed.items()
    ]
    if not mixed:
        lines.append("least squares tells the mains' hum from the drive over each of these dwells")
    if prices.saturated:
        lines.append("a film is over-ranged: none of these figures is of use")
    else:
        lines += [f"for {100 * each.target:g} %: {way_of(each)}" for each in prices.recommended]
    print_all(table, *lines, *([] if plot is None else [f"plot           {plot}"]))


def way_of(found: RecommendedDwell) -> str:
    """The way to a target in words, or why there is none."""
    if found.sets is None or found.dwell_s is None or found.seconds is None:
        return found.why
    sets = "one load set" if found.sets == 1 else f"the mean of {found.sets:,} load sets"
    return f"{sets} of {found.dwell_s:g} s by {found.estimator}: {duration(found.seconds)} on the bench"


def plot_dwell(prices: DwellPrices, title: str, folder: Path) -> Path:
    """Draws `dwell.png` in a folder: the uncertainty of one load set with all its parts, then its noise and bias alone.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    figure, (whole, noise, bias) = new_figure(True, 3, title)
    for number, name in enumerate(dict.fromkeys(p.estimator for p in prices.points)):
        own = [p for p in prices.points if p.estimator == name]
        style = f"C{number}{MARKERS[number]}-"
        dwells = [p.dwell_s for p in own]
        whole.plot(dwells, [p.whole_u for p in own], style, ms=5, lw=1, label=name)
        noise.plot(dwells, [p.u for p in own], style, ms=5, lw=1, label=name)
        bias.errorbar(dwells, [abs(p.bias) for p in own], [p.bias_u for p in own], fmt=style, ms=5, lw=1, label=name)
    if prices.floor_u > 0:
        whole.axhline(prices.floor_u, color="0.4", ls=":", label="floor that no dwell beats")
    bound = {p.dwell_s: p.bound for p in prices.points}
    noise.plot(list(bound), list(bound.values()), "k--", lw=1, label="Cramér–Rao bound")
    labels = "uncertainty of one load set, all in", "noise alone", "size of the bias alone"
    for ax, label in zip((whole, noise, bias), labels, strict=True):
        ax.set(xscale="log", yscale="log", xlabel="dwell (s)", ylabel=f"{label}, relative")
        ax.legend(fontsize=7)
    return save_in_new(figure, folder, PLOT)
