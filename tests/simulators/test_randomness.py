"""Random streams: the n-th number depends on seed, name and n alone, and the numbers are normal."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from palpate.simulators.randomness import BLOCK, Stream

LONG = 200_000
FAR = 30 * 86_400 * 1_000_000  # microseconds in 30 days


@pytest.fixture(scope="module")
def numbers() -> npt.NDArray[np.float64]:
    return Stream(1, "white_noise", 1, 0).normal(0, LONG)


def test_any_start_and_length_gives_the_numbers_of_the_whole() -> None:
    whole = Stream(7, "a").normal(0, 3 * BLOCK)
    cases = np.random.default_rng(3).integers([0, 1], [2 * BLOCK, BLOCK], (100, 2)).tolist()
    for first, count in [*cases, *((f, c) for f in range(6) for c in range(1, 7))]:
        assert Stream(7, "a").normal(first, count).tobytes() == whole[first : first + count].tobytes()


@pytest.mark.parametrize("size", [1, 7, 333, 1000])
def test_blocks_of_any_size_join_to_the_same_bytes_far_from_the_start(size: int) -> None:
    stream, n = Stream(7, "a"), 1001
    blocks = [stream.normal(FAR + i, min(size, n - i)) for i in range(0, n, size)]
    assert np.concatenate(blocks).tobytes() == stream.normal(FAR, n).tobytes()


def test_a_seed_gives_the_same_numbers_in_every_version() -> None:
    stream = Stream(1, "white_noise", 1, 0)
    assert stream.normal(0, 3) == pytest.approx([1.8600247700082981, 0.8468610740972352, -1.573743189187849], rel=1e-12)
    assert stream.normal(BLOCK, 2) == pytest.approx([1.1951548764195834, -0.1981294271384565], rel=1e-12)


def test_mean_variance_skewness_and_kurtosis_are_those_of_the_standard_normal(
    numbers: npt.NDArray[np.float64],
) -> None:
    error = 1 / np.sqrt(LONG)
    assert abs(numbers.mean()) < 4 * error
    assert abs(numbers.var() - 1) < 4 * np.sqrt(2) * error
    assert abs((numbers**3).mean()) < 4 * np.sqrt(15) * error
    assert abs((numbers**4).mean() - 3) < 4 * np.sqrt(96) * error


def test_a_stream_is_white(numbers: npt.NDArray[np.float64]) -> None:
    for lag in (1, 2, 3, 4, 5, 333, 1000, BLOCK, 2 * BLOCK):
        assert abs((numbers[lag:] * numbers[:-lag]).mean()) < 4 / np.sqrt(LONG)


@pytest.mark.parametrize(
    ("seed", "name"),
    [
        (2, ("white_noise", 1, 0)),
        (1, ("white_noise", 2, 0)),
        (1, ("white_noise", 1, 1)),
        (1, ("white_noise", 10)),
        (1, ("white_noise", "1", 0)),
        (1, ("gain_scatter", 1, 0)),
        (11, ("white_noise", 0)),
        (2**63 - 1, ("white_noise", 1, 0)),
    ],
)
def test_another_seed_or_name_gives_uncorrelated_numbers(
    seed: int, name: tuple[object, ...], numbers: npt.NDArray[np.float64]
) -> None:
    other = Stream(seed, *name).normal(0, LONG)
    for lag in range(-4, 5):
        shifted = np.roll(other, lag)
        assert abs((numbers * shifted).mean()) < 4.5 / np.sqrt(LONG)
        assert abs((numbers**2 * shifted**2).mean() - 1) < 4.5 * np.sqrt(8 / LONG)
