"""The phase of a drive is an exact count, against arithmetic that forgets."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from palpate.simulators.linear.periodic import CYCLE, HERTZ, Periodic
from tests.simulators.linear_systems import DAY, SECOND, rich, sine


def exact_phase(drive: Periodic, time_ns: int) -> int:
    """In integers without a bound."""
    return (drive.start_phase + drive.frequency * (time_ns - drive.start_ns)) % CYCLE


def test_the_phase_is_exact_for_30_days_at_any_frequency_of_the_generator() -> None:
    for start in [0, 17, 86_399 * SECOND + 1]:
        for frequency in [0, 1, 333, 9_965_244_293, 10 * HERTZ, 1_234_567_890_123, 20_000 * HERTZ]:
            drive = Periodic(0.0, frequency, start, CYCLE - 1, np.array([1]), np.ones(1, complex))
            near = np.arange(-3, 4)
            times = np.concatenate([start + near, start + SECOND + near, start + 30 * DAY + near])
            assert drive.phase(times).tolist() == [exact_phase(drive, int(t)) for t in times]
            grid = start + 30 * DAY + 999_999 * np.arange(2500)
            assert drive.phase(grid, 999_999).tolist() == [exact_phase(drive, int(t)) for t in grid]


def summed(step: np.floating, count: int) -> float:
    """What `total += step` gives after `count` times, rounding each time.

    Between two powers of two the rounded increment is the same every time, so whole binades are done at once.
    """
    kind = type(step)
    total, left = kind(0), count
    while left:
        increment = kind(total + step) - total
        if increment == 0:
            return float(total)
        binade = kind(2.0 ** math.floor(math.log2(total))) * kind(2) if total else step
        jump = min(left, max(1, math.floor(Fraction(float(binade - total)) / Fraction(float(increment))) - 1))
        total = kind(float(total) + jump * float(increment)) if jump > 1 else kind(total + step)
        left -= jump
    return float(total)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_the_summing_of_this_test_is_what_a_loop_does(kind: type[np.floating]) -> None:
    step = kind(2 * math.pi * 10e-3)
    looped = np.add.accumulate(np.full(300_000, step, kind), dtype=kind)
    for count in (1, 2, 3, 1000, 99_999, 300_000):
        assert summed(step, count) == looped[count - 1]


def test_after_1e9_samples_the_phase_is_exact_where_floating_point_sums_are_lost() -> None:
    samples, step_ns = 10**9, 1_000_037  # 1 kHz by a quartz that is 37 ppm off
    drive = sine(frequency=9_973_000_000)
    truth = exact_phase(drive, samples * step_ns)
    assert drive.phase(np.array([samples * step_ns]))[0] == truth

    radians = 2 * math.pi * 9.973 * 1e-9 * step_ns
    single = summed(np.float32(radians), samples)
    assert single < 0.05 * radians * samples  # it stands still once a step is less than half a digit
    double = summed(np.float64(radians), samples) / (2 * math.pi) - truth / CYCLE
    assert 360 * abs(double - round(double)) > 1.0  # degrees


def test_a_drive_counted_from_a_later_moment_is_the_same_bytes() -> None:
    drive = rich(25)
    times = 10 * DAY + np.arange(0, SECOND, 7_654_321)
    assert drive.restarted(9 * DAY + 1).at(times).tobytes() == drive.at(times).tobytes()


def test_scaling_scales_the_whole_function() -> None:
    drive, times = rich(5), np.arange(2 * SECOND, 3 * SECOND, 13_000_001)
    assert np.allclose(drive.scaled(-2.5, offset=7.0).at(times), 7.0 - 2.5 * drive.at(times), rtol=0, atol=1e-14)
