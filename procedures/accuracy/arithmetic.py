"""Prices of numbers with few bits: error and time of a fit, of a phase, and of samples in registers, measured now."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from palpate.instrument.contracts.sensor_node import FULL_SCALE_COUNTS, RANGES
from palpate.instrument.quantity import parse
from palpate.instrument.signals.estimate import amplitudes
from palpate.procedures.accuracy.measure import seconds_of

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


@dataclass(frozen=True, slots=True)
class ArithmeticPrice:
    """One way to compute or keep a number: greatest relative error, and CPU seconds."""

    task: str
    way: str
    error: float
    seconds: float


def measure() -> Iterator[ArithmeticPrice]:
    """Measure every task in every way, which takes about a second."""
    yield from _fits()
    yield from _phases()
    yield from _registers()


def _fits() -> Iterator[ArithmeticPrice]:
    time = LATE + np.arange(round(DWELL * RATE)) / RATE
    signal = OFFSET + np.cos(2 * np.pi * FREQUENCY * time + 0.3)
    ways: dict[str, Callable[[], float]] = {
        "float64, centred QR": lambda: float(amplitudes(time, signal[np.newaxis], FREQUENCY)[0]),
        "float64, normal equations": lambda: _normal(time, signal, "float64"),
        "float32, normal equations": lambda: _normal(time, signal, "float32"),
    }
    for way, fit in ways.items():
        yield ArithmeticPrice("fit of a late record on an offset", way, abs(fit() - 1), seconds_of(fit))


def _normal(time: Floats, signal: Floats, real: Real) -> float:
    """Amplitude by normal equations of the plain columns, the most obvious way."""
    t, y = time.astype(real), signal.astype(real)
    angle = np.array(2 * np.pi * FREQUENCY, real) * t
    columns = np.stack([np.cos(angle), np.sin(angle), np.ones_like(t), t], axis=1)
    a, b, *_ = np.linalg.solve(columns.T @ columns, columns.T @ y)
    return float(np.hypot(a, b))


def _phases() -> Iterator[ArithmeticPrice]:
    step = FREQUENCY / 1000  # cycles in a millisecond
    true = STEPS * round(step * (1 << BITS)) % (1 << BITS) / (1 << BITS)

    def summed(real: Real) -> float:
        return float(np.cumsum(np.full(STEPS, step, real))[-1]) - STEPS * step

    def counted() -> float:
        words = np.cumsum(np.full(STEPS, round(step * (1 << BITS)), np.uint64))
        return int(words[-1]) % (1 << BITS) / (1 << BITS) - true

    ways: dict[str, Callable[[], float]] = {
        "integer of 48 bits": counted,
        "float64 sum": lambda: summed("float64"),
        "float32 sum": lambda: summed("float32"),
    }
    for way, phase in ways.items():
        error = 2 * abs(float(np.sin(np.pi * phase())))  # over a sine's amplitude; two is the greatest
        yield ArithmeticPrice(f"phase after {STEPS:.0e} steps", way, error, seconds_of(phase))


def _registers() -> Iterator[ArithmeticPrice]:
    time = np.arange(round(DWELL * RATE)) / RATE
    films = FILM * NEAR[:, np.newaxis] * np.cos(2 * np.pi * FREQUENCY * time + 0.3)
    noise = NOISE * np.random.default_rng(1).normal(size=films.shape)
    without = amplitudes(time, films + noise, FREQUENCY)
    for name in RANGES:
        step = parse(name, "V") / FULL_SCALE_COUNTS
        for kind, volts, true in (("quiet", films, FILM * NEAR), ("in noise", films + noise, without)):
            rounded = np.rint(volts / step).astype(np.int16).astype(np.float64) * step
            error = float(np.abs(amplitudes(time, rounded, FREQUENCY) / true - 1).max())
            way = f"int16 of {name}, {kind}"
            yield ArithmeticPrice("film's samples", way, error, _converting(volts, step, np.int16) / len(NEAR))
    single = films.astype(np.float32)
    error = float(np.abs(amplitudes(time, single.astype(np.float64), FREQUENCY) / (FILM * NEAR) - 1).max())
    yield ArithmeticPrice("film's samples", "float32, quiet", error, _converting(films, 1.0, np.float32) / len(NEAR))
    loads = LOAD_MV * NEAR
    for decimals in (0, 1):
        error = float(np.abs(np.round(loads, decimals) / loads - 1).max())
        way = f"display of {10.0**-decimals:g} mV"
        yield ArithmeticPrice("load's reading", way, error, _converting(loads, 10.0**-decimals, np.int16) / len(NEAR))


def _converting(values: Floats, step: float, kind: type[np.int16] | type[np.float32]) -> float:
    return seconds_of(lambda: np.rint(values / step).astype(kind))
