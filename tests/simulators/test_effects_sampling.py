"""What happens between the films' amplifiers and the samples: hum, noise, jitter, the converter's steps."""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.signals.estimate import fit_sine
from palpate.simulators import randomness
from palpate.simulators.bounds import bound_of, fitted
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.effects.adc import Adc
from palpate.simulators.effects.charge_amplifier import ChargeAmplifier
from palpate.simulators.effects.curve_error import CurveError
from palpate.simulators.effects.gain_scatter import GainScatter
from palpate.simulators.effects.glue_clamping import GlueClamping
from palpate.simulators.effects.jitter import Jitter
from palpate.simulators.effects.load_cell import LoadCell
from palpate.simulators.effects.mains_hum import MainsHum
from palpate.simulators.effects.mounting_scatter import MountingScatter
from palpate.simulators.effects.pink_noise import PinkNoise
from palpate.simulators.effects.white_noise import WhiteNoise
from palpate.simulators.physics.effect import Bound, Case, Effect, InputEffect
from palpate.simulators.planning.plan import Question, case_of, driven, sampled
from palpate.simulators.randomness import BLOCK, Stream
from palpate.simulators.rig import Rig, RigLoadCell
from palpate.simulators.scenes.scene import Scene
from tests.simulators.rigs import BALANCE, MS, SECOND, pressed, scene

MONTH = 30 * 86_400 * SECOND
STRONG: dict[str, InputEffect] = {
    "mains_hum": MainsHum(amplitude="20 mV", frequency="49.87 Hz", phase=0.3),
    "pink_noise": PinkNoise(density="20 µV/√Hz"),
    "white_noise": WhiteNoise(density="20 µV/√Hz"),
    "jitter": Jitter(delay="1 ms"),
}


def rates(time_ns: Times) -> Floats:
    """Rates of some signal [V/s]."""
    return np.asarray(np.cos(1e-9 * (time_ns % SECOND)))


def volts(effect: InputEffect, time_ns: Times, period_ns: int = MS, name: object = "a") -> Floats:
    return effect.volts(Stream(1, name), time_ns, period_ns, lambda: rates(time_ns))


# --- how much is drawn ---------------------------------------------------------------------------------

NOTHING: dict[str, Effect] = {
    "curve_error": CurveError(spread=0.0),
    "mounting_scatter": MountingScatter(scatter=0.0),
    "gain_scatter": GainScatter(strength=0.0),
    "pink_noise": PinkNoise(density="0 V/√Hz"),
    "white_noise": WhiteNoise(density="0 V/√Hz"),
    "jitter": Jitter(delay="0 s"),
    "load_cell": LoadCell(noise="0 V"),
}


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many random numbers each call of the generator gave."""
    found: list[int] = []

    class Counting(np.random.Generator):
        def standard_normal(self, size: int) -> Floats:  # type: ignore[override]
            found.append(size)
            return np.asarray(super().standard_normal(size))

    monkeypatch.setattr(randomness._OWN, "generator", Counting(np.random.SFC64(0)))  # private: each thread has its own
    return found


def sampled_with(effects: dict[str, Effect]) -> Floats:
    """Samples of both films of the single sensor, whose node has four channels; and readings of the load cell."""
    chosen = replace(scene(), effects=effects)
    rig = driven(chosen, Question())
    cell = RigLoadCell(rig)
    assert cell.shown(1.0, 3) >= 1.0
    return sampled(chosen, rig, 4 * MS * np.arange(500, 750), 4 * MS)[0]


@pytest.mark.parametrize("name", ["pink_noise", "white_noise", "jitter"])
def test_numbers_are_drawn_for_channels_with_a_film_alone(name: str, drawn: list[int]) -> None:
    volts(STRONG[name], 4 * MS * np.arange(500, 750), 4 * MS)
    of_a_channel = sum(drawn)
    drawn.clear()
    sampled_with({name: STRONG[name]})
    assert sum(drawn) == 2 * of_a_channel > 0


def test_at_strength_0_nothing_is_drawn_and_nothing_changes(drawn: list[int]) -> None:
    found = sampled_with(NOTHING)
    assert drawn == []
    error = {"curve_error": NOTHING["curve_error"]}  # its constant part stays
    assert np.array_equal(found, sampled_with(error))


# --- at any time, in any blocks ------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "start_ns"), [*zip(STRONG, itertools.cycle([MONTH, 0]))])
def test_blocks_of_any_size_join_to_the_same_bytes_from_the_start_and_after_30_days(name: str, start_ns: int) -> None:
    times = start_ns + MS * np.arange(2500)
    whole = volts(STRONG[name], times).tobytes()
    assert len(set(whole)) > 20
    for size in (1, 7, 333, 1000):
        blocks = (times[i : i + size] for i in range(0, len(times) if size > 1 else 300, size))
        assert whole.startswith(b"".join(volts(STRONG[name], block).tobytes() for block in blocks)), size


def test_the_1_f_noise_of_a_month_later_takes_a_second_of_numbers_not_a_month(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: set[tuple[Stream, int]] = set()
    block = Stream.block

    def counted(stream: Stream, number: int) -> Floats:
        drawn.add((stream, number))
        return block(stream, number)

    monkeypatch.setattr(Stream, "block", counted)
    volts(PinkNoise(), MONTH + MS * np.arange(1000), name="never asked before")
    assert 1000 < BLOCK * len(drawn) < 60_000
    assert len({stream for stream, _ in drawn}) == 5  # one for the decades above 10 Hz, one for each of those below


# --- hum -----------------------------------------------------------------------------------------------


def test_hum_keeps_its_phase_exactly_for_30_days() -> None:
    hum = MainsHum(amplitude="1 V", frequency="49.987654321 Hz", phase=0.125)
    times = MONTH + MS * np.arange(1500)
    exact = [Fraction(49_987_654_321, 10**9) * int(t) / 10**9 + Fraction(1, 8) for t in times]
    assert volts(hum, times) == pytest.approx([math.sin(2 * math.pi * float(turns % 1)) for turns in exact], abs=1e-14)


def test_hum_is_the_same_on_all_channels_and_orthogonal_to_10_hz_over_whole_cycles() -> None:
    hum = MainsHum(amplitude="1 mV")
    times = 4 * MS * np.arange(250)
    assert volts(hum, times, 4 * MS, "a").tobytes() == volts(hum, times, 4 * MS, "b").tobytes()
    assert np.abs(volts(hum, times, 4 * MS)).max() == pytest.approx(1e-3, rel=0.05)
    fit = fit_sine(1e-9 * times, volts(hum, times, 4 * MS)[np.newaxis], 10.0)
    assert fit.amplitude[0] < 1e-3 * 5e-3  # the trend alone lets it through


@pytest.mark.parametrize("frequency", ["50 Hz", "49.97 Hz", "49.9999 Hz"])  # repeats after 20, 100 000, ... samples
def test_hum_is_the_sine_of_its_phase_wherever_it_is_begun(frequency: str) -> None:
    hum, stream = MainsHum(amplitude="1 V", frequency=frequency, phase=0.2), Stream(1, "hum")
    for first, count in ((3, 100), (20_007, 5000), (11, 7)):
        number = np.arange(first, first + count)
        sought = np.sin(2 * np.pi * (float(frequency.split()[0]) * 1e-3 * number + 0.2))
        assert hum.volts(stream, MS * number, MS, lambda: np.zeros(0)) == pytest.approx(sought, abs=1e-9)


# --- 1/f noise -----------------------------------------------------------------------------------------


def spectrum(noise: PinkNoise, period_ns: int, size: int, records: int) -> tuple[Floats, Floats]:
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
        frequency, power = spectrum(PinkNoise(density="3 µV/√Hz", corner="10 Hz"), period_ns, 2**14, records)
        for low, high in itertools.pairwise(edges):
            inside = (frequency >= low) & (frequency < high)
            bands.append(math.sqrt(low * high))
            seen.append(float((power * frequency)[inside].mean() / (9e-12 * 10)))
            freedom.append(records * inside.sum() / 1.5)  # the window joins neighbouring lines
    assert (np.abs(np.array(seen) - 1) < 0.06 + 3 / np.sqrt(freedom)).all()
    assert np.average(seen, weights=freedom) == pytest.approx(1, abs=0.03)
    slope = np.polyfit(np.log(bands), np.log(np.array(seen) / np.array(bands)), 1, w=np.sqrt(freedom))[0]
    assert slope == pytest.approx(-1, abs=0.02)


def test_each_decade_of_1_f_noise_has_the_same_variance_and_the_numbers_are_normal() -> None:
    noise = PinkNoise(density="1 V/√Hz", corner="1 Hz")
    for period_ns, decades in ((100 * SECOND, 1 + 1 / math.pi), (10 * SECOND, 2 + 1 / math.pi)):
        values = volts(noise, period_ns * np.arange(40_000), period_ns)
        assert values.var() == pytest.approx(decades * math.log(10), rel=0.05)
        assert (values**4).mean() / values.var() ** 2 == pytest.approx(3, abs=0.25)


def test_1_f_noise_is_independent_between_streams_and_follows_the_seed() -> None:
    times = SECOND * np.arange(4000)
    one, other = (volts(PinkNoise(), times, SECOND, name) for name in ("a", "b"))
    steps = np.corrcoef(np.diff(one), np.diff(other))[0, 1]
    assert abs(steps) < 4.5 / math.sqrt(4000)
    assert volts(PinkNoise(), times, SECOND, "a").tobytes() == one.tobytes() != other.tobytes()


# --- jitter --------------------------------------------------------------------------------------------


def node_on(effects: dict[str, Effect], seed: int = 1) -> tuple[Rig, SimulatedSensorNode]:
    """A node under a sample that is pressed and shaken."""
    clock = VirtualClock()
    rig = Rig(replace(scene(), effects=effects, seed=seed), clock)
    pressed(rig, "2", BALANCE + 7e-3, 4.0)
    return rig, SimulatedSensorNode(clock, 1, 1, rig)


def test_a_jittered_sample_is_that_of_a_moment_earlier_or_later() -> None:
    rig, _ = node_on({"charge_amplifier": ChargeAmplifier()})
    times = 4 * MS * np.arange(1, 500)
    film = rig.film_rates(times)[1]
    stream = Stream(1, "a")
    delays = np.rint(1e9 * 10e-6 * stream.normal(1, len(times))).astype(np.int64)
    moved = rig.film_voltages(times + delays)[1] - rig.film_voltages(times)[1]
    added = Jitter(delay="10 µs").volts(stream, times, 4 * MS, lambda: film)
    bend = 20 * np.pi * np.abs(film).max()  # V/s2
    rounded = 1e-9 * np.abs(film).max()  # of the delays
    assert added == pytest.approx(moved, abs=bend * (1e-9 * np.abs(delays).max()) ** 2 / 2 + rounded)
    assert np.abs(added).max() > 500 * np.abs(added - moved).max()


def test_jitter_of_a_node_follows_the_rate_of_each_channel() -> None:
    for name, fast in (("still", False), ("shaken", True)):
        rig, node = node_on({"jitter": Jitter(delay="1 ms")})
        if not fast:
            rig.set_voltage(rig.coil_voltage().scaled(0.0))
        times = 4 * MS * np.arange(1, 500)
        clean = node.film_channels @ rig.film_voltages(times)
        taken = node.sample(times, clean, 4 * MS)
        moved = taken.counts - np.rint(clean.T / 5 * 32768)
        assert (np.abs(moved[:, 1]).max() > 10) == fast, name
        assert not moved[:, 2:].any()


# --- the converter -------------------------------------------------------------------------------------


@pytest.mark.parametrize("effects", [{}, {"adc": Adc()}, {"adc": Adc(bits=8)}])
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


def test_a_converter_of_fewer_bits_clips_at_its_own_last_step() -> None:
    values, saturated = Adc(bits=8).convert(np.array([0.995, 127 / 128, -1.0, -1.01, 1.0]))
    assert values.tolist() == [127 / 128, 127 / 128, -1.0, -1.0, 127 / 128]
    assert saturated.tolist() == [False, False, False, True, True]


# --- bounds --------------------------------------------------------------------------------------------


def results(time: Floats, films: Floats, chosen: Scene, frequency: float) -> tuple[float, float]:
    """Force of the total film and force ratio, as the brief of a bound has them."""
    amplitude = fit_sine(time, films, frequency).amplitude
    rigid, total = (a / film.sensitivity for a, film in zip(amplitude, chosen.design.films, strict=True))
    return total, rigid / total


@functools.cache
def settled(question: Question) -> tuple[Rig, Case, Times, int]:
    """A rig that is driven, its measurement, and the times and period of its samples."""
    amplifier: dict[str, Effect] = {"charge_amplifier": ChargeAmplifier(time_constant="0.05 s")}
    chosen = replace(scene(), effects=amplifier)
    case = case_of(chosen.design, chosen.model, amplifier, question)
    period_ns = round(1e9 / case.rate)
    first = round(case.settled * 1e9) // period_ns
    times = (first + np.arange(round(question.dwell * case.rate))) * period_ns
    return driven(chosen, question), case, times, period_ns


def change(effect: Effect, question: Question, seed: int) -> Bound:
    """What the effect changes in one measurement, relatively."""
    rig, _, times, period_ns = settled(question)
    films = rig.film_voltages(times)
    if isinstance(effect, InputEffect):
        before = films
        after = films + [
            effect.volts(Stream(seed, row), times, period_ns, lambda row=row: rig.film_rates(times)[row])
            for row in range(len(films))
        ]
    else:
        assert isinstance(effect, Adc)
        before, after = films, 5 * effect.convert(films / 5)[0]
    was, became = (results(1e-9 * times, v, rig.scene, question.frequency) for v in (before, after))
    return Bound(*(abs(b - a) / a for a, b in zip(was, became, strict=True)))


QUESTIONS = [
    Question(sample, load, frequency, dwell)
    for sample, load in (("2", 1.5), ("1", 4.0))
    for frequency in (10.0, 0.7, 17.3)
    for dwell in (0.5, 1.0, 2.33)
    if frequency * dwell > 1
]
TRIED: dict[str, Effect] = {
    **STRONG,
    "mains_hum": MainsHum(amplitude="0.1 mV", frequency="19 Hz"),
    "adc": Adc(bits=14),
    "pink_noise": PinkNoise(),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", TRIED)
def test_no_measurement_changes_by_more_than_the_bound_and_some_by_a_tenth_of_it(name: str) -> None:
    nearest = 0.0
    for question in QUESTIONS:
        bound = bound_of(settled(question)[1], TRIED[name])
        for seed in range(6):
            changed = change(TRIED[name], question, seed)
            assert changed.force <= bound.force, (question, seed)
            assert changed.ratio <= bound.ratio, (question, seed)
            nearest = max(nearest, changed.force / bound.force)
    assert nearest > 0.1


def test_what_cannot_change_anything_is_bounded_by_round_off() -> None:
    case = settled(Question())[1]
    silent = (WhiteNoise(density="0 V/√Hz"), PinkNoise(density="0 V/√Hz"), MainsHum(amplitude="0 V"))
    for effect in (*silent, Jitter(delay="0 s")):
        found = bound_of(case, effect)
        assert max(found.force, found.ratio) < 10 * np.finfo(float).eps


def test_a_film_that_gives_hardly_anything_leaves_no_bound_of_the_ratio() -> None:
    chosen = scene()
    case = case_of(chosen.design, chosen.model, {"glue_clamping": GlueClamping(factor=1e-6)}, Question())
    noise = WhiteNoise(density="20 µV/√Hz")
    beside = replace(case, effects={**case.effects, "pink_noise": PinkNoise()})
    assert bound_of(beside, noise).ratio == math.inf
    assert bound_of(beside, noise).force < 0.01


def test_the_bound_of_the_ratio_is_that_of_a_tooth_too_loud_over_a_base_too_quiet() -> None:
    case = case_of(scene().design, scene().model, {}, Question())
    rigid, total = (bound_of(case, WhiteNoise(density=f"{density} V/√Hz")) for density in (1e-6, 1e-5))
    quiet = bound_of(case, GlueClamping(factor=0.5, films=("total",)))
    assert quiet.ratio == pytest.approx(1.0) and quiet.force == pytest.approx(0.5)
    assert total.ratio > 10 * rigid.ratio > 10 * rigid.force


def test_a_bound_grows_with_what_the_other_effects_take_from_the_signal() -> None:
    case = settled(Question())[1]
    noise = WhiteNoise()
    for other in (
        {"gain_scatter": GainScatter()},
        {"mains_hum": MainsHum(amplitude="10 mV", frequency="17.3 Hz")},
        {"charge_amplifier": ChargeAmplifier(time_constant="5 ms")},
        {"adc": Adc()},
    ):
        beside: dict[str, Effect] = {**case.effects, **other}
        assert bound_of(replace(case, effects=beside), noise).ratio > 1.01 * bound_of(case, noise).ratio, other


def test_beside_a_converter_the_least_noise_can_change_both_results_by_its_rounding() -> None:
    case = settled(Question())[1]
    beside = replace(case, effects={**case.effects, "adc": Adc()})
    step, amplitude = 10 / 2**16, abs(fitted(case, case.follow(case.effects).volts(linear=True))[:, 1]).min()
    bound = bound_of(beside, MainsHum(amplitude="1 nV")).force
    assert 0.02 * step / amplitude < bound < 4 / math.pi * step / amplitude


def test_a_bound_is_that_of_the_worst_phase() -> None:
    """A tone of the drive's own frequency adds all of itself."""
    chosen = replace(scene(), effects={})
    case = case_of(chosen.design, chosen.model, {}, Question())
    total = chosen.design.film("total").sensitivity * Question().load / 2
    hum = MainsHum(amplitude="1 mV", frequency="10 Hz")
    assert bound_of(case, hum).force == pytest.approx(1e-3 / total, rel=0.01)
