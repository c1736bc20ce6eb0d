"""Error and time of every method that computes a number, task by task: one table, and one picture.

Each task has a clock of its own. Errors are relative to the true number; of models they are bounds.
"""

from __future__ import annotations

import math
import time
import timeit
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.contracts.own import FULL_SCALE_COUNTS, RANGES
from palpate.instrument.errors import EstimateError
from palpate.instrument.models.price_list import DATA, PriceList
from palpate.instrument.quantity import parse, show
from palpate.instrument.signals.estimate import (
    ESTIMATORS,
    LEAST_SQUARES,
    amplitude_ratios,
    amplitudes,
    fit_sine,
    ratio_bound,
)
from palpate.procedures.showing.figure import MARKERS, write
from palpate.procedures.showing.text import new_table, print_all, stamped

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Clock = Literal["processor", "bench"]
FRONT = "*"
LEAST = 1e-16  # error of an exact method in the picture
INTERVAL = 1  # of the price list's moduli: the rubber samples
DWELLS = (0.1, 0.4, 2.0, 10.0)  # s
MOST = 1000  # pieces of a record
BOUND = "Cramér–Rao bound"
STYLES = ("-", "--", "-.", ":")


@dataclass(frozen=True, slots=True)
class Way:
    """A method at a setting: relative error (None: it failed), and seconds of its task's clock."""

    method: str
    setting: str
    error: float | None
    seconds: float
    failure: str = ""


@dataclass(frozen=True, slots=True)
class Task:
    """A number, and the ways to it.

    Attributes:
        name: what the number is.
        drawn: whether error is bought with time, so that the picture shows it.
        reference: error of what the errors are measured against; 0: it is exact, or not known.
        slopes: for some methods the exponent with which the error should fall with time.
    """

    name: str
    clock: Clock
    ways: tuple[Way, ...]
    drawn: bool = True
    reference: float = 0.0
    slopes: Mapping[str, float] = field(default_factory=dict)

    def front(self) -> list[bool]:
        """Of each way, whether no other is nearer and quicker."""
        pairs = [
            (math.inf if way.error is None or way.method == BOUND else way.error, way.seconds) for way in self.ways
        ]
        return [
            one[0] < math.inf and not any(other != one and other[0] <= one[0] and other[1] <= one[1] for other in pairs)
            for one in pairs
        ]

    def summary(self) -> dict[str, Any]:
        """The task as JSON has it."""
        head = {"task": self.name, "clock": self.clock, "reference": self.reference}
        rows = zip(self.ways, self.front(), strict=True)
        return {**head, "ways": [{**asdict(way), "front": front} for way, front in rows]}


def seconds_of(call: Callable[[], object]) -> float:
    """Processor time of one call [s]: the least of five rounds of 20 ms or more."""
    timer = timeit.Timer(call, timer=time.process_time)
    count = 1
    while timer.timeit(count) < 0.02:
        count *= 2
    return min(timer.repeat(5, count)) / count


def of_models(prices: PriceList, design: str) -> Task:
    """Every answer that a caller gets from a model, for objects like the rubber samples; data are no model.

    Raises:
        RangeError: nothing was priced for the design.
    """
    at, own = slice(INTERVAL, INTERVAL + 1), prices.of([design])
    (reference,) = own.references
    ways = [
        Way(price.model, price.refinement, promise, price.answer_s)
        for price in own.prices
        if price.model != DATA and price.answer_s is not None
        if (promise := prices.promise(price, at)) is not None
    ]
    (least,) = prices.least(design)[at]
    reference_u = max(reference.uncertainties[INTERVAL : INTERVAL + 2]) / least
    low, high = (show(modulus, "Pa", 3) for modulus in prices.moduli_Pa[INTERVAL : INTERVAL + 2])
    return Task(
        f"force ratio of design {design}, objects of {low} to {high}", "processor", tuple(ways), True, reference_u
    )


def of_estimators(
    time: npt.NDArray[np.float64], voltage: npt.NDArray[np.float64], ratio: float, frequency: float, where: str
) -> Task:
    """Every estimator of the ratio of two films' amplitudes, over pieces of a long record.

    Args:
        time, voltage: (n,) and (2, n), the record [s, V].
        ratio: the true ratio.
        frequency: frequency of the drive [Hz].
        where: whose record it is.

    Raises:
        EstimateError: a piece gives no ratio.
    """
    whole = fit_sine(time, voltage, frequency)
    ways = []
    for dwell in DWELLS:
        n = round(dwell / float(time[1] - time[0]))
        repeats = min(time.size // n, MOST)
        # An amplitude does not depend on the phase at which a piece begins.
        pieces = voltage[:, : repeats * n].reshape(2, repeats, n).swapaxes(0, 1)
        for name in ESTIMATORS:
            apart = amplitude_ratios(name, time[:n], pieces, frequency) / ratio - 1
            if not np.isfinite(apart).all():
                raise EstimateError(f"{name}: a piece of the record gives no ratio; take a longer dwell")
            ways.append(Way(name, f"{dwell:g} s", float(np.sqrt(np.mean(apart**2))), dwell))
        noise = (whole.amplitude[:2], whole.phase[:2], whole.noise[:2], float(whole.correlation[0, 1]))
        ways.append(Way(BOUND, f"{dwell:g} s", ratio_bound(time[:n], frequency, *noise), dwell))
    ways.sort(key=lambda way: (*ESTIMATORS, BOUND).index(way.method))
    return Task(f"force ratio of {where}", "bench", tuple(ways), slopes={LEAST_SQUARES: 0.5})


def print_numerics(tasks: Sequence[Task], about: str, plot: str | None) -> None:
    """Print one table: a part for each task, and a row for each way."""
    for task in tasks:
        title = stamped(task.clock == "bench", task.name)
        table = new_table(title, "method", "setting", "relative error", f"{task.clock} s", "")
        table.columns[0].justify = table.columns[1].justify = "left"
        for way, front in zip(task.ways, task.front(), strict=True):
            error = "-" if way.error is None else f"{way.error:.1e}"
            table.add_row(way.method, way.setting, error, f"{way.seconds:.2g}", FRONT if front else "")
        print_all(table, *(f"{way.method}, {way.setting}: {way.failure}" for way in task.ways if way.failure), "")
    print_all(
        f"{FRONT:<14} no other method is nearer and quicker",
        f"models         {about}",
        *([] if plot is None else [f"plot           {plot}"]),
    )


def plot_numerics(tasks: Sequence[Task], file: Path) -> None:
    """Draw into a file: a panel for each task whose error is bought with time.

    Raises:
        RecordError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    drawn = [task for task in tasks if task.drawn]
    rows = -(-len(drawn) // 2)
    figure = Figure(figsize=(7, 4.3 * rows), layout="constrained")
    for place, task in enumerate(drawn):
        _draw(task, figure.add_subplot(rows, 2, place + 1))
    write(figure, file)


def _draw(task: Task, ax: Axes) -> None:
    """Error against time of each method, expected slopes beside, the reference's own error, and failures on top."""
    from matplotlib.ticker import NullFormatter

    ax.set(xscale="log", yscale="log", xlabel=f"{task.clock} time (s)", ylabel="relative error")
    for number, method in enumerate(dict.fromkeys(way.method for way in task.ways)):
        own = [way for way in task.ways if way.method == method]
        good = [(way.seconds, max(way.error, LEAST)) for way in own if way.error is not None]
        style = {"color": f"C{number}", "ls": STYLES[number % len(STYLES)], "marker": MARKERS[number % len(MARKERS)]}
        if method == BOUND:
            style = {"color": "k", "ls": "-", "marker": ""}
        ax.plot([x for x, _ in good], [y for _, y in good], **style, ms=5, lw=1, mfc="none", label=method)  # type: ignore[arg-type]
        failed = [way.seconds for way in own if way.error is None]
        ax.plot(failed, [1.0] * len(failed), **style | {"ls": ""}, ms=8, clip_on=False)  # type: ignore[arg-type]
        if method in task.slopes and good:
            (x, y), p = good[-1], task.slopes[method]
            ax.axline((x, y / 1.6), (2 * x, y / 1.6 / 2**p), color="0.3", lw=0.6, zorder=1)
            ax.plot([], [], color="0.3", lw=0.6, label=f"time to the power -{p:g}")
    if task.reference > 0:
        ax.set_ylim(bottom=min(ax.get_ylim()[0], task.reference / 3))
        ax.axhspan(ax.get_ylim()[0], task.reference, color="0.85", zorder=0, label="error of the reference")
    if any(way.error is None for way in task.ways):
        ax.set_ylim(top=1.0)
        ax.plot([], [], " ", label="full, on top: no answer")
    ax.grid(alpha=0.3)
    ax.xaxis.set_minor_formatter(NullFormatter())
    stamp = "SIMULATED, " if task.clock == "bench" else ""
    ax.set_title(stamp + task.name.replace(", ", ",\n", 1), fontsize=9)
    entries = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    ax.legend(
        entries.values(), entries, fontsize=8, ncols=2, loc="upper center", bbox_to_anchor=(0.45, -0.2), frameon=False,
        columnspacing=1, handlelength=2.4,
    )  # fmt: skip


# --- Numbers with few bits: error and time of a fit, of a phase, and of samples in registers, measured now

Real = Literal["float32", "float64"]

FREQUENCY, RATE, DWELL = 10.0, 250.0, 10.0
OFFSET, LATE = 1000.0, 86_400.0  # offset of a film that warms up, in amplitudes; s, a day on the bench
STEPS = 2_000_000  # steps of a clock of 1 kHz, which are half an hour
BITS = 48  # bits of the integer phase
FILM = 1.24e-3  # V, amplitude under sample 2 at 3 N: the tooth's film of the thesis
NOISE = 22e-6  # V a sample, 2 µV/√Hz at 250 Hz
LOAD_MV = 3.0 * 10.306  # reading of the strain indicator at 3 N
NEAR = np.linspace(0.95, 1.05, 41)  # sizes near the nominal one, because rounding depends on the size


def arithmetic_tasks() -> Iterator[Task]:
    """Measure every task in every way, which takes about a second."""
    yield _task("amplitude of a late record on an offset", _fits(), lambda found: abs(found - 1))
    # Over a sine's amplitude, of which two is the greatest.
    yield _task(f"phase after {STEPS:.0e} steps", _phases(), lambda cycles: 2 * abs(float(np.sin(np.pi * cycles))))
    yield Task("amplitude from a film's samples", "processor", tuple(_samples()), drawn=False)
    yield Task("reading of a load", "processor", tuple(_readings()), drawn=False)


def _task(name: str, ways: Mapping[str, Callable[[], float]], error: Callable[[float], float]) -> Task:
    found = tuple(Way(way, "", error(compute()), seconds_of(compute)) for way, compute in ways.items())
    return Task(name, "processor", found, drawn=False)


def _fits() -> dict[str, Callable[[], float]]:
    time, signal = late_sine(DWELL, RATE, FREQUENCY)
    return {
        "float64, centred QR": lambda: float(amplitudes(time, signal[np.newaxis], FREQUENCY)[0]),
        "float64, normal equations": lambda: _normal(time, signal, "float64"),
        "float32, normal equations": lambda: _normal(time, signal, "float32"),
    }


def late_sine(dwell: float, rate: float, frequency: float) -> tuple[Floats, Floats]:
    """Times [s] and values of a sine of amplitude 1 that is hard to fit: late, and on a large offset."""
    time = LATE + np.arange(round(dwell * rate)) / rate
    return time, OFFSET + np.cos(2 * np.pi * frequency * time + 0.3)


def _normal(time: Floats, signal: Floats, real: Real) -> float:
    """Amplitude by normal equations of the plain columns, the most obvious way."""
    t, y = time.astype(real), signal.astype(real)
    angle = np.array(2 * np.pi * FREQUENCY, real) * t
    columns = np.stack([np.cos(angle), np.sin(angle), np.ones_like(t), t], axis=1)
    a, b, *_ = np.linalg.solve(columns.T @ columns, columns.T @ y)
    return float(np.hypot(a, b))


def _phases() -> dict[str, Callable[[], float]]:
    """Errors of a phase in cycles."""
    step = FREQUENCY / 1000  # cycles in a millisecond
    true = STEPS * round(step * (1 << BITS)) % (1 << BITS) / (1 << BITS)

    def summed(real: Real) -> float:
        return float(np.cumsum(np.full(STEPS, step, real))[-1]) - STEPS * step

    def counted() -> float:
        words = np.cumsum(np.full(STEPS, round(step * (1 << BITS)), np.uint64))
        return int(words[-1]) % (1 << BITS) / (1 << BITS) - true

    return {
        f"integer of {BITS} bits": counted,
        "float64 sum": lambda: summed("float64"),
        "float32 sum": lambda: summed("float32"),
    }


def _samples() -> Iterator[Way]:
    time = np.arange(round(DWELL * RATE)) / RATE
    films = FILM * NEAR[:, np.newaxis] * np.cos(2 * np.pi * FREQUENCY * time + 0.3)
    noisy = films + NOISE * np.random.default_rng(1).normal(size=films.shape)
    cases = {"quiet": (films, FILM * NEAR), "in noise": (noisy, amplitudes(time, noisy, FREQUENCY))}
    for name in RANGES:
        for kind, (volts, true) in cases.items():
            step = parse(name, "V") / FULL_SCALE_COUNTS
            yield _kept(time, volts, true, f"int16 of {name}", kind, partial(_counted, step))
    yield _kept(time, films, FILM * NEAR, "float32", "quiet", lambda volts: volts.astype(np.float32).astype(np.float64))


def _counted(step: float, volts: Floats) -> Floats:
    return np.rint(volts / step).astype(np.int16).astype(np.float64) * step


def _kept(time: Floats, volts: Floats, true: Floats, way: str, kind: str, keep: Callable[[Floats], Floats]) -> Way:
    error = float(np.abs(amplitudes(time, keep(volts), FREQUENCY) / true - 1).max())
    return Way(way, kind, error, seconds_of(lambda: keep(volts)) / len(NEAR))


def _readings() -> Iterator[Way]:
    loads = LOAD_MV * NEAR
    for decimals in (0, 1):
        error = float(np.abs(np.round(loads, decimals) / loads - 1).max())
        seconds = seconds_of(partial(np.round, loads, decimals)) / len(NEAR)
        yield Way(f"display of {10.0**-decimals:g} mV", "", error, seconds)
