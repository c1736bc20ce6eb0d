"""What happens between the films' amplifiers and the samples: hum, noise, jitter, the converter's steps."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from palpate.instrument.arrays import Floats, Times
from palpate.simulators.bounds import bound_of, fitted
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.physics.effect import Case, Effect, InputEffect
from palpate.simulators.planning.plan import Question, case_of
from palpate.simulators.randomness import Stream
from palpate.simulators.rig import Rig
from tests.simulators.rigs import MS, SECOND, an_effect, scene, shaken

MONTH = 30 * 86_400 * SECOND
STRONG: dict[str, InputEffect] = {
    "mains_hum": an_effect("mains_hum", amplitude="20 mV", frequency="49.87 Hz", phase=0.3),
    "pink_noise": an_effect("pink_noise", density="20 µV/√Hz"),
    "white_noise": an_effect("white_noise", density="20 µV/√Hz"),
    "jitter": an_effect("jitter", delay="1 ms"),
}


def rates(time_ns: Times) -> Floats:
    """Rates of some signal [V/s]."""
    return np.asarray(np.cos(1e-9 * (time_ns % SECOND)))


def volts(effect: InputEffect, time_ns: Times, period_ns: int = MS, name: object = "a") -> Floats:
    return effect.volts(Stream(1, name), time_ns, period_ns, lambda: rates(time_ns))


# --- at any time, in any blocks ------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "start_ns"), [*zip(STRONG, itertools.cycle([MONTH, 0]))])
def test_blocks_of_any_size_join_to_the_same_bytes_from_the_start_and_after_30_days(name: str, start_ns: int) -> None:
    times = start_ns + MS * np.arange(2500)
    whole = volts(STRONG[name], times).tobytes()
    assert len(set(whole)) > 20
    for size in (1, 7, 333, 1000):
        blocks = (times[i : i + size] for i in range(0, len(times) if size > 1 else 300, size))
        assert whole.startswith(b"".join(volts(STRONG[name], block).tobytes() for block in blocks)), size


# --- hum -----------------------------------------------------------------------------------------------


def test_hum_keeps_its_phase_exactly_for_30_days() -> None:
    hum = an_effect("mains_hum", amplitude="1 V", frequency="49.987654321 Hz", phase=0.125)
    times = MONTH + MS * np.arange(1500)
    exact = [Fraction(49_987_654_321, 10**9) * int(t) / 10**9 + Fraction(1, 8) for t in times]
    assert volts(hum, times) == pytest.approx([math.sin(2 * math.pi * float(turns % 1)) for turns in exact], abs=1e-14)


@pytest.mark.parametrize("frequency", ["50 Hz", "49.97 Hz", "49.9999 Hz"])  # repeats after 20, 100 000, ... samples
def test_hum_is_the_sine_of_its_phase_wherever_it_is_begun(frequency: str) -> None:
    hum, stream = an_effect("mains_hum", amplitude="1 V", frequency=frequency, phase=0.2), Stream(1, "hum")
    for first, count in ((3, 100), (20_007, 5000), (11, 7)):
        number = np.arange(first, first + count)
        sought = np.sin(2 * np.pi * (float(frequency.split()[0]) * 1e-3 * number + 0.2))
        assert hum.volts(stream, MS * number, MS, lambda: np.zeros(0)) == pytest.approx(sought, abs=1e-9)


# --- 1/f noise -----------------------------------------------------------------------------------------


def spectrum(noise: InputEffect, period_ns: int, size: int, records: int) -> tuple[Floats, Floats]:
    """One-sided power density [V2/Hz] over frequency [Hz], the mean of independent records."""
    window = np.hanning(size)
    power = np.zeros(size // 2 + 1)
    for number in range(records):
        record = volts(noise, period_ns * np.arange(size), period_ns, number)
        power += np.abs(np.fft.rfft(window * (record - record.mean()))) ** 2
    scale = 2 * period_ns * 1e-9 / (records * (window**2).sum())
    return np.fft.rfftfreq(size, 1e-9 * period_ns), scale * power


def test_1_f_noise_has_its_density_at_the_corner_and_falls_as_1_f_over_four_decades() -> None:
    records, bands, seen, freedom = 12, [], [], []
    for period_ns, edges in ((MS, np.geomspace(1, 100, 9)), (100 * MS, np.geomspace(0.01, 1, 9))):
        frequency, power = spectrum(
            an_effect("pink_noise", density="3 µV/√Hz", corner="10 Hz"), period_ns, 2**14, records
        )
        for low, high in itertools.pairwise(edges):
            inside = (frequency >= low) & (frequency < high)
            bands.append(math.sqrt(low * high))
            seen.append(float((power * frequency)[inside].mean() / (9e-12 * 10)))
            freedom.append(records * inside.sum() / 1.5)  # the window joins neighbouring lines
    assert (np.abs(np.array(seen) - 1) < 0.06 + 3 / np.sqrt(freedom)).all()
    assert np.average(seen, weights=freedom) == pytest.approx(1, abs=0.03)
    slope = np.polyfit(np.log(bands), np.log(np.array(seen) / np.array(bands)), 1, w=np.sqrt(freedom))[0]
    assert slope == pytest.approx(-1, abs=0.02)


def test_1_f_noise_is_independent_between_streams_and_follows_the_seed() -> None:
    times = SECOND * np.arange(4000)
    one, other = (volts(an_effect("pink_noise"), times, SECOND, name) for name in ("a", "b"))
    steps = np.corrcoef(np.diff(one), np.diff(other))[0, 1]
    assert abs(steps) < 4.5 / math.sqrt(4000)
    assert volts(an_effect("pink_noise"), times, SECOND, "a").tobytes() == one.tobytes() != other.tobytes()


# --- jitter --------------------------------------------------------------------------------------------


def node_on(effects: dict[str, Effect]) -> tuple[Rig, SimulatedSensorNode]:
    """A node under a sample that is pressed and shaken."""
    rig = shaken(effects, amplitude=4.0)
    return rig, SimulatedSensorNode(rig.clock, 1, 1, rig)


def test_a_jittered_sample_is_that_of_a_moment_earlier_or_later() -> None:
    rig, _ = node_on({"charge_amplifier": an_effect("charge_amplifier")})
    times = 4 * MS * np.arange(1, 500)
    film = rig.film_rates(times)[1]
    stream = Stream(1, "a")
    delays = np.rint(1e9 * 10e-6 * stream.normal(1, len(times))).astype(np.int64)
    moved = rig.film_voltages(times + delays)[1] - rig.film_voltages(times)[1]
    added = an_effect("jitter", delay="10 µs").volts(stream, times, 4 * MS, lambda: film)
    bend = 20 * np.pi * np.abs(film).max()  # V/s2
    rounded = 1e-9 * np.abs(film).max()  # of the delays
    assert added == pytest.approx(moved, abs=bend * (1e-9 * np.abs(delays).max()) ** 2 / 2 + rounded)
    assert np.abs(added).max() > 500 * np.abs(added - moved).max()


def test_jitter_of_a_node_follows_the_rate_of_each_channel() -> None:
    for size in (0.0, 1.0):
        rig, node = node_on({"jitter": an_effect("jitter", delay="1 ms")})
        rig.set_voltage(rig.coil_voltage().scaled(size))
        times = 4 * MS * np.arange(1, 500)
        clean = node.film_channels @ rig.film_voltages(times)
        taken = node.sample(times, clean, 4 * MS)
        moved = taken.counts - np.rint(clean.T / 5 * 32768)
        assert (np.abs(moved[:, 1]).max() > 10) == (size > 0)
        assert not moved[:, 2:].any()


# --- the converter -------------------------------------------------------------------------------------


@pytest.mark.parametrize("effects", [{}, {"adc": an_effect("adc")}, {"adc": an_effect("adc", bits=8)}])
def test_a_sample_that_is_no_number_or_endless_is_flagged_and_spreads_to_no_other(effects: dict[str, Effect]) -> None:
    _, node = node_on(effects)
    times = MS * np.arange(1, 6)
    films = np.zeros((4, 5))
    films[0, 1], films[1, 2], films[2, 3], films[3, 4] = np.nan, np.inf, -np.inf, 1.0
    taken = node.sample(times, films, MS)
    assert taken.saturation.tolist() == [0, 1, 2, 4, 0]
    assert taken.counts[1].tolist() == [0, 0, 0, 0]
    assert taken.counts[2, 1] > 32_000 and taken.counts[3, 2] == -32768
    assert np.count_nonzero(taken.counts) == 3


# --- bounds --------------------------------------------------------------------------------------------


def amplified() -> Case:
    """A measurement behind charge amplifiers."""
    amplifier: dict[str, Effect] = {"charge_amplifier": an_effect("charge_amplifier", time_constant="0.05 s")}
    return case_of(scene().design, scene().model, amplifier, Question())


def test_what_cannot_change_anything_is_bounded_by_round_off() -> None:
    case = amplified()
    for effect in (
        an_effect("white_noise", density="0 V/√Hz"),
        an_effect("pink_noise", density="0 V/√Hz"),
        an_effect("mains_hum", amplitude="0 V"),
        an_effect("jitter", delay="0 s"),
    ):
        found = bound_of(case, effect)
        assert max(found.force, found.ratio) < 10 * np.finfo(float).eps


def test_a_film_that_gives_hardly_anything_leaves_no_bound_of_the_ratio() -> None:
    chosen = scene()
    case = case_of(chosen.design, chosen.model, {"glue_clamping": an_effect("glue_clamping", factor=1e-6)}, Question())
    noise = an_effect("white_noise", density="20 µV/√Hz")
    beside = replace(case, effects={**case.effects, "pink_noise": an_effect("pink_noise")})
    assert bound_of(beside, noise).ratio == math.inf
    assert bound_of(beside, noise).force < 0.01


def test_the_bound_of_the_ratio_is_that_of_a_tooth_too_loud_over_a_base_too_quiet() -> None:
    case = case_of(scene().design, scene().model, {}, Question())
    rigid, total = (bound_of(case, an_effect("white_noise", density=f"{density} V/√Hz")) for density in (1e-6, 1e-5))
    quiet = bound_of(case, an_effect("glue_clamping", factor=0.5, films=("total",)))
    assert quiet.ratio == pytest.approx(1.0) and quiet.force == pytest.approx(0.5)
    assert total.ratio > 10 * rigid.ratio > 10 * rigid.force


def test_a_bound_grows_with_what_the_other_effects_take_from_the_signal() -> None:
    case = amplified()
    noise = an_effect("white_noise")
    for other in (
        {"gain_scatter": an_effect("gain_scatter")},
        {"mains_hum": an_effect("mains_hum", amplitude="10 mV", frequency="17.3 Hz")},
        {"charge_amplifier": an_effect("charge_amplifier", time_constant="5 ms")},
        {"adc": an_effect("adc")},
    ):
        beside: dict[str, Effect] = {**case.effects, **other}
        assert bound_of(replace(case, effects=beside), noise).ratio > 1.01 * bound_of(case, noise).ratio, other


def test_beside_a_converter_the_least_noise_can_change_both_results_by_its_rounding() -> None:
    case = amplified()
    beside = replace(case, effects={**case.effects, "adc": an_effect("adc")})
    step, amplitude = 10 / 2**16, abs(fitted(case, case.follow(case.effects).volts(linear=True))[:, 1]).min()
    bound = bound_of(beside, an_effect("mains_hum", amplitude="1 nV")).force
    assert 0.02 * step / amplitude < bound < 4 / math.pi * step / amplitude


def test_a_bound_is_that_of_the_worst_phase() -> None:
    """A tone of the drive's own frequency adds all of itself."""
    chosen = replace(scene(), effects={})
    case = case_of(chosen.design, chosen.model, {}, Question())
    total = chosen.design.film("total").sensitivity * Question().load / 2
    hum = an_effect("mains_hum", amplitude="1 mV", frequency="10 Hz")
    assert bound_of(case, hum).force == pytest.approx(1e-3 / total, rel=0.01)


@pytest.mark.parametrize(
    ("volts", "cast", "counts"),
    [(0.0, 0, 0), (1e-300, 0, 0), (-5.0, -32_768, -32_768), (5.0, -32_768, 32_767), (6.0, -26_214, 32_767)],
)
def test_nothing_and_full_scale_are_converted_where_a_cast_turns_round(volts: float, cast: int, counts: int) -> None:
    assert np.array(round(volts / 5.0 * 2**15)).astype(np.int16) == cast
    node = SimulatedSensorNode(VirtualClock(), 1, 1, Rig(scene(), VirtualClock()))
    samples = node.sample(np.arange(1, 4) * MS, np.full((4, 3), volts), MS)
    assert (samples.counts == counts).all()
    assert (samples.saturation == (0b1111 if volts >= 5.0 else 0)).all()
