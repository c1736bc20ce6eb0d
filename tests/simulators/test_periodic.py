"""The phase of a drive is an exact count, against arithmetic that forgets."""

from __future__ import annotations

import numpy as np

from palpate.simulators.linear.periodic import CYCLE, HERTZ, Periodic
from tests.simulators.linear_systems import DAY, SECOND, rich


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


def test_a_drive_counted_from_a_later_moment_is_the_same_bytes() -> None:
    drive = rich(25)
    times = 10 * DAY + np.arange(0, SECOND, 7_654_321)
    assert drive.restarted(9 * DAY + 1).at(times).tobytes() == drive.at(times).tobytes()


def test_scaling_scales_the_whole_function() -> None:
    drive, times = rich(5), np.arange(2 * SECOND, 3 * SECOND, 13_000_001)
    assert np.allclose(drive.scaled(-2.5, offset=7.0).at(times), 7.0 - 2.5 * drive.at(times), rtol=0, atol=1e-14)
