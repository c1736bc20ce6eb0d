"""Numbers with few bits: error and time of a fit, of a phase, and of samples in registers, measured now."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Literal

import numpy as np
import numpy.typing as npt

from palpate.instrument.contracts.own import FULL_SCALE_COUNTS, RANGES
from palpate.instrument.quantity import parse
from palpate.instrument.signals.estimate import amplitudes
from palpate.procedures.accuracy.measure import seconds_of
from palpate.procedures.accuracy.numerics import Task, Way

Floats = npt.NDArray[np.float64]
Real = Literal["float32", "float64"]

FREQUENCY, RATE, DWELL = 10.0, 250.0, 10.0
OFFSET, LATE = 1000.0, 86_400.0  # offset of a film that warms up, in amplitudes; s, a day on the bench
STEPS = 2_000_000  # steps of a clock of 1 kHz, which are half an hour
BITS = 48  # bits of the integer phase
FILM = 1.24e-3  # V, amplitude under sample 2 at 3 N: the tooth's film of the thesis
NOISE = 22e-6  # V a sample, 2 µV/√Hz at 250 Hz
LOAD_MV = 3.0 * 10.306  # reading of the strain indicator at 3 N
NEAR = np.linspace(0.95, 1.05, 41)  # sizes near the nominal one, because rounding depends on the size


def tasks() -> Iterator[Task]:
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
    time = LATE + np.arange(round(DWELL * RATE)) / RATE
    signal = OFFSET + np.cos(2 * np.pi * FREQUENCY * time + 0.3)
    return {
        "float64, centred QR": lambda: float(amplitudes(time, signal[np.newaxis], FREQUENCY)[0]),
        "float64, normal equations": lambda: _normal(time, signal, "float64"),
        "float32, normal equations": lambda: _normal(time, signal, "float32"),
    }


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
