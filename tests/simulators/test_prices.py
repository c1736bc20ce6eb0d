"""Prices of scenes: lines of processor time over the seconds of bench, and how they are measured."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.instrument.notice import notices_to
from palpate.simulators.linear.free_motion import free_motion
from palpate.simulators.linear.path import forget
from palpate.simulators.planning import weights
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.waveforms import films_sampled
from palpate.simulators.planning.weights import FEWEST, PriceLine, digits, leaving_out, line, timed
from palpate.simulators.scenes.scene import Scene

DWELLS = np.array([1.0, 10.0, 40.0, 100.0])
SCENE = read_scene("thesis_single")
QUIET = leaving_out(SCENE, ["white_noise"])


def test_a_line_is_found_among_calls_that_were_held_up_and_its_uncertainties_hold() -> None:
    """Each time has a scatter of 3 %, and one in five takes up to twice as long; the median is told, and no mean."""
    rng, off = np.random.default_rng(1), []

    def factors(rounds: int) -> Floats:
        held_up = np.where(rng.random((rounds, 4)) < 0.2, 1 + rng.random((rounds, 4)), 1.0)
        return np.asarray(held_up * (1 + 0.03 * rng.standard_normal((rounds, 4))))

    middle = float(np.median(factors(100_000)))
    assert middle < 1.02
    for _ in range(60):
        found = line(DWELLS, (12e-3 + 90e-6 * DWELLS) * factors(30))
        off += [(found.a_s - 12e-3 * middle) / found.u_a_s, (found.b_s_per_s - 90e-6 * middle) / found.u_b_s_per_s]
    assert np.mean(np.abs(off) < 2) > 0.9
    assert np.max(np.abs(off)) < 5
    assert found.u_a_s < 0.5e-3
    assert found.u_b_s_per_s < 10e-6


@pytest.mark.parametrize(
    ("value", "u", "text"),
    [
        (12.63, 0.21, "12.6"), (94.2, 3.1, "94"), (94.2, 13.0, "90"), (0.3, 0.21, "< 0.5"), (-0.3, 0.21, "< 0.5"),
        (-7.24, 0.2, "-7.2"), (8.0, 5.0, "< 10"), (0.999, 0.012, "1.00"), (0.0, 0.0, "0"), (3.0, 0.0, "3"),
    ],
)  # fmt: skip
def test_no_digit_below_the_uncertainty_is_told(value: float, u: float, text: str) -> None:
    assert digits(value, u) == text
    assert PriceLine(value * 1e-3, u * 1e-3, 1e-6, 1e-9).texts()[0] == text


class Machine:
    """A machine whose calls take 10 ms and 100 µs a second of bench, and white noise 2 ms and 50 µs a second of it.

    It stands for the function whose time is taken, and for the clocks, since no real machine's times are known.
    """

    def __init__(self, scatter: float) -> None:
        self.now, self.wall, self.scatter, self.rng = 0.0, 0.0, scatter, np.random.default_rng(2)
        self.calls: list[tuple[bool, int, float]] = []

    def sample(self, scene: Scene, _: Question, dwell: float) -> None:
        assert not gc.isenabled()
        noisy = "white_noise" in scene.effects
        self.calls.append((noisy, scene.seed, dwell))
        spent = 10e-3 + 100e-6 * dwell + noisy * (2e-3 + 50e-6 * dwell)
        self.now += spent * (1 + self.scatter * self.rng.standard_normal())
        self.wall += 10 * spent


@pytest.fixture
def machine(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Machine]:
    found = Machine(request.param)
    monkeypatch.setattr(weights, "films_sampled", found.sample)
    monkeypatch.setattr(time, "process_time", lambda: found.now)
    monkeypatch.setattr(time, "monotonic", lambda: found.wall)
    yield found
    assert gc.isenabled()


@pytest.mark.parametrize("machine", [0.0], indirect=True)
def test_scenes_are_timed_in_rounds_of_one_seed_and_random_order_and_the_first_call_of_a_dwell_does_not_count(
    machine: Machine,
) -> None:
    taken = timed([SCENE, QUIET], Question())
    whole, more = taken.of(0), taken.more(0, 1)
    assert (whole.a_s, whole.b_s_per_s) == pytest.approx((12e-3, 150e-6))
    assert (more.a_s, more.b_s_per_s) == pytest.approx((2e-3, 50e-6))
    assert taken.dwells.tolist() == DWELLS.tolist() and len(taken.seconds) == FEWEST
    calls = machine.calls[1:]  # the first tells how long all will take
    assert len(calls) == FEWEST * len(DWELLS) * 3
    for number in range(FEWEST):
        own = calls[number * 3 * len(DWELLS) :][: 3 * len(DWELLS)]
        assert {seed for _, seed, _ in own} == {SCENE.seed + number}
        assert sorted(dwell for _, _, dwell in own) == sorted([*DWELLS] * 3)


@pytest.mark.parametrize("machine", [0.5], indirect=True)
def test_rounds_double_while_a_price_is_uncertain_up_to_a_minute_and_that_is_told(machine: Machine) -> None:
    heard: list[str] = []
    with notices_to(heard.append):
        taken = timed([SCENE, QUIET], Question())
    assert len(taken.seconds) > FEWEST
    assert taken.more(0, 1).u_a_s <= 0.1 * taken.of(0).a_s or 60 <= machine.wall < 65
    assert heard == ["timing 2 scenes takes about 5 s"]


@pytest.mark.parametrize("machine", [0.0], indirect=True)
@pytest.mark.parametrize("frequency", [0.02, 500.0])
def test_dwells_are_as_many_cycles_at_any_frequency(machine: Machine, frequency: float) -> None:
    taken = timed([SCENE], Question(frequency=frequency))
    assert (taken.dwells * frequency).tolist() == pytest.approx([10, 100, 400, 1000])
    assert machine.calls
    times, volts = films_sampled(SCENE, Question(frequency=frequency), float(taken.dwells[0]))
    assert volts.shape == (2, len(times)) == (2, 250)


def test_what_is_forgotten_is_computed_anew() -> None:
    matrix = np.array([[-2.0]])
    first = free_motion(matrix)
    assert free_motion(matrix) is first
    forget()
    assert free_motion(matrix) is not first
