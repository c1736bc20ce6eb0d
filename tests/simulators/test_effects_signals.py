"""What each effect makes of the films' signals: by formulas and integrators of their own."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.models import springs
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import MOST, array_of
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.signals.estimate import fit_sine
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.effects import humidity_leak
from palpate.simulators.effects.viscoelastic import PRONY
from palpate.simulators.linear.periodic import HERTZ
from palpate.simulators.physics.effect import Effect, InputEffect
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.plan import driven as measured
from palpate.simulators.planning.plan import phasors as settled
from palpate.simulators.randomness import Stream
from palpate.simulators.rig import Rig
from tests.simulators.rigs import MS, SECOND, an_effect, scene, shaken

ANY = Stream(1, "any")


def amplitudes(rig: Rig, first_ns: int = SECOND) -> Floats:
    times = first_ns + np.arange(0, SECOND, MS)
    return fit_sine(1e-9 * times, rig.film_voltages(times), 10.0).amplitude


def change(effects: Mapping[str, Effect], design: str = "single") -> Floats:
    """Relative changes of the films' amplitudes."""
    return amplitudes(shaken(effects, design=design)) / amplitudes(shaken({}, design=design)) - 1


# --- gains ---------------------------------------------------------------------------------------------


def test_glue_on_one_film_takes_57_percent_of_the_ratio_and_on_both_none() -> None:
    rigid, total = change({"glue_clamping": an_effect("glue_clamping")})
    assert (1 + rigid) / (1 + total) - 1 == pytest.approx(-0.57, abs=1e-12)
    rigid, total = change({"glue_clamping": an_effect("glue_clamping", films=("rigid", "total"), factor=0.59)})
    assert (rigid, total) == pytest.approx((-0.41, -0.41), abs=1e-12)
    assert rigid == pytest.approx(total, abs=1e-12)


def test_ten_degrees_take_1_5_percent_of_the_force_and_none_of_the_ratio() -> None:
    rigid, total = change({"off_axis": an_effect("off_axis")})
    assert total == pytest.approx(math.cos(math.radians(10)) - 1, abs=1e-12)
    assert total == pytest.approx(-0.015, abs=5e-4)
    assert rigid == pytest.approx(total, abs=1e-12)


def test_the_lateral_part_adds_by_the_sine_of_the_angle() -> None:
    _, total = change({"off_axis": an_effect("off_axis", angle="30 deg", lateral=0.4)})
    assert total == pytest.approx(math.cos(math.pi / 6) + 0.4 * 0.5 - 1, abs=1e-12)


# --- neighbours ----------------------------------------------------------------------------------------


def test_neighbours_on_a_common_base_add_5_2_percent_under_equal_loads() -> None:
    changed = change({"crosstalk": an_effect("crosstalk")}, "common_base")
    assert changed == pytest.approx([0.052, 0.052, 0.0], abs=1e-12)


def test_the_parts_of_a_neighbour_are_those_of_table_a2_7() -> None:
    """Rows 3 and 7: the load in the middle of the compliant part, and over the tooth itself."""
    assert an_effect("crosstalk").compliant == pytest.approx(0.02416 / 0.46355, rel=0.005)
    assert an_effect("crosstalk").rigid == pytest.approx(9.41e-5 / 0.99788, rel=0.05)
    changed = change({"crosstalk": an_effect("crosstalk", over_teeth=1.0)}, "common_base")
    assert changed == pytest.approx([9e-5, 9e-5, 0.0], abs=1e-12)


@pytest.mark.parametrize("design", ["single", "different_base"])
def test_teeth_without_a_neighbour_on_their_base_feel_nothing_of_one(design: str) -> None:
    assert (change({"crosstalk": an_effect("crosstalk", compliant=0.24)}, design) == 0).all()


def neighbours(design: Design) -> Floats:
    """Which teeth are neighbours, by their numbers: two rows, each from left to right."""
    columns = design.columns
    count = len(design.teeth)
    beside = np.zeros((count, count))
    for k in range(count):
        for other in (
            k - columns,
            k + columns,
            *([k - 1] if k % columns else []),
            *([k + 1] if (k + 1) % columns else []),
        ):
            if 0 <= other < count:
                beside[k, other] = 1.0
    return beside


def test_twenty_teeth_with_the_strongest_crosstalk_still_tell_their_forces_apart() -> None:
    design = array_of(MOST)
    matrix = an_effect("crosstalk", compliant=0.24).matrix(design, ANY, 0)
    assert matrix[:MOST, :MOST] == pytest.approx(np.eye(MOST) + 0.24 * neighbours(design), abs=1e-12)
    assert np.linalg.cond(matrix) < 12
    # A larger part would leave nothing of a pattern of pushed and pulled teeth.
    singular = 1 / (1 + 2 * math.cos(math.pi / (design.columns + 1)))
    assert np.linalg.cond(np.eye(MOST) + singular * neighbours(design)) > 1e12
    with pytest.raises(ValueError, match=r"compliant\n.*less than or equal to 0\.24"):
        an_effect("crosstalk", compliant=singular)


# --- warmth --------------------------------------------------------------------------------------------


def test_warming_passes_the_charge_amplifier_as_two_exponentials() -> None:
    amplifier: dict[str, Effect] = {"charge_amplifier": an_effect("charge_amplifier", time_constant="1 s")}
    warm = {**amplifier, "pyroelectric": an_effect("pyroelectric", drift="20 mK/s", settling="5 s")}
    times = np.arange(0, 20 * SECOND, 77 * MS)
    added = shaken(warm).film_voltages(times) - shaken(amplifier).film_voltages(times)
    t = 1e-9 * times
    kelvin = 20e-3 * (np.exp(-t / 5) - np.exp(-t)) / (1 / 1 - 1 / 5)
    assert added[1] == pytest.approx(68.60e-3 * 150.0 * kelvin, rel=1e-9, abs=1e-12)


# --- cables --------------------------------------------------------------------------------------------


def test_a_cable_of_a_tenth_of_a_picocoulomb_adds_two_percent_to_the_tooth() -> None:
    """0.1 pC beside the 20 pC/N of the film, at 3 N peak to peak; the tooth takes 0.14 to 0.31 of the force."""
    changed = change({"triboelectric": an_effect("triboelectric")})
    rig = shaken({})
    ratio = float(amplitudes(rig) @ [68.60e-3 / 5.995e-3, 0]) / float(amplitudes(rig)[1])
    per_newton = 0.1 / 20 / 1.5
    assert changed == pytest.approx([per_newton / ratio, per_newton], rel=1e-9)
    assert 0.01 < (1 + changed[0]) / (1 + changed[1]) - 1 < 0.025


# --- amplifiers and leaks ----------------------------------------------------------------------------

DISC, SQUARE, CABLE = 26e-12, 425e-12, 100e-12


def network(capacitance: float, conductance: Callable[[float], float], end: float) -> Callable[[Floats], Floats]:
    """Voltage across film, cable and resistor over the film's own step, for 1 + sin(20 pi t) from time 0 on."""
    total = capacitance + CABLE

    def slope(t: float, volts: Floats) -> Floats:
        return (capacitance * 20 * math.pi * math.cos(20 * math.pi * t) - conductance(t) * volts) / total

    start = capacitance / total
    solved = scipy.integrate.solve_ivp(
        slope, (0, end), [start], method="DOP853", rtol=1e-11, atol=1e-14, dense_output=True
    )
    return lambda time: np.asarray(solved.sol(time)[0])


def unit(rig: Rig) -> tuple[Floats, float]:
    """Amplitudes of the films without an amplifier, and the preload over the amplitude of the force."""
    times = np.arange(0, 100 * MS, MS)
    films = rig.film_voltages(times)
    return np.ptp(films, axis=1) / 2, float(films[1].mean() / (np.ptp(films[1]) / 2))


@pytest.mark.parametrize("resistance", ["100 Mohm", "1 Gohm", "100 Gohm"])
def test_a_voltage_amplifier_is_loaded_by_its_cable_as_the_network_says(resistance: str) -> None:
    bare = shaken({})
    rig = shaken({"voltage_amplifier": an_effect("voltage_amplifier", resistance=resistance)})
    ohms = an_effect("voltage_amplifier", resistance=resistance).resistance
    times = np.arange(0, 400 * MS, MS)
    (amplitudes, preload), films = unit(bare), rig.film_voltages(times)
    t = 1e-9 * times
    for number, capacitance in enumerate((DISC, SQUARE)):
        waves = network(capacitance, lambda _: 1 / ohms, 0.4)(t)
        steps = capacitance / (capacitance + CABLE) * np.exp(-t / (ohms * (capacitance + CABLE)))
        expected = amplitudes[number] * ((waves - steps) + preload * steps)
        assert films[number] == pytest.approx(expected, rel=1e-7, abs=1e-7 * amplitudes[number])


def test_cables_take_74_to_94_percent_of_the_film_under_the_tooth() -> None:
    bare = shaken({})
    for cable, lost in (("74 pF", 0.74), ("100 pF", 0.794), ("407 pF", 0.94)):
        rig = shaken({"voltage_amplifier": an_effect("voltage_amplifier", cable=cable, resistance="1 Tohm")})
        times = SECOND + np.arange(0, 100 * MS, MS)
        left = np.ptp(rig.film_voltages(times), axis=1) / np.ptp(bare.film_voltages(times), axis=1)
        assert left[0] == pytest.approx(1 - lost, abs=2e-3)
        assert left[1] > left[0]  # the ratio changes too


@pytest.mark.slow
def test_a_leak_across_a_voltage_amplifier_drains_as_the_changing_network_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(humidity_leak, "EPOCHS", 300)
    leak = an_effect("humidity_leak", dry="1 Tohm", wet="1 Gohm", over="2 s")
    rig = shaken({"voltage_amplifier": an_effect("voltage_amplifier"), "humidity_leak": leak})
    bare = shaken({})
    amplitudes, preload = unit(bare)
    # Preload and sine by superposition: the network is linear in both.
    exact = network(DISC, lambda t: 1e-9 + leak.conductance(t), 2.0)
    step = scipy.integrate.solve_ivp(
        lambda t, v: -(1e-9 + leak.conductance(t)) / (DISC + CABLE) * v, (0, 2.0), [DISC / (DISC + CABLE)],
        method="DOP853", rtol=1e-10, atol=1e-16, dense_output=True,
    )  # fmt: skip
    worst = 0.0
    for moment in (0.25, 1.0, 1.8):
        rig.clock.wait(moment - 1e-9 * rig.clock.now_ns())
        times = np.array([rig.clock.now_ns()])
        waves, steps = exact(1e-9 * times), step.sol(1e-9 * times)[0]
        expected = amplitudes[0] * ((waves - steps) + preload * steps)
        worst = max(worst, float(np.abs(rig.film_voltages(times)[0] - expected).max() / amplitudes[0]))
    assert worst < 1e-3  # epochs of 7 ms in which the leak stands still


def test_a_leak_before_a_charge_amplifier_gives_an_offset_and_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(humidity_leak, "EPOCHS", 50)
    leak = an_effect("humidity_leak", dry="1 Tohm", wet="100 Mohm", over="1 s")
    wet, dry = (
        shaken({"charge_amplifier": an_effect("charge_amplifier"), "humidity_leak": leak}),
        shaken({"charge_amplifier": an_effect("charge_amplifier")}),
    )
    for rig in (wet, dry):
        rig.clock.wait(1.5)
    times = wet.clock.now_ns() + np.arange(0, 300 * MS, MS)
    offset = 1e-3 * 1e9 / 1e8  # input offset times feedback over leak
    assert wet.film_voltages(times) - dry.film_voltages(times) == pytest.approx(np.full((2, 300), offset), rel=1e-9)


def test_a_leak_has_the_resistances_that_it_begins_and_ends_with_and_falls_by_equal_parts() -> None:
    leak = an_effect("humidity_leak")
    assert [1 / leak.conductance(t) for t in (0.0, 1800.0, 3600.0, 1e9)] == pytest.approx([1e12, 1e10, 1e8, 1e8])


def test_a_leak_without_an_amplifier_that_loads_the_film_never_begins_anything_anew() -> None:
    rig = shaken({"humidity_leak": an_effect("humidity_leak", wet="1 Mohm", over="1 s")})
    begun = rig.path
    assert rig.next_event_ns() == NEVER
    rig.clock.wait(0.5)
    assert rig.path is begun
    times = 400 * MS + np.arange(0, 100 * MS, MS)
    assert rig.film_voltages(times).tobytes() == shaken({}).film_voltages(times).tobytes()


# --- generator, shaker and samples -------------------------------------------------------------------

FORCE_CONSTANT, RESISTANCE, SUSPENSION = 4.0, 3.5, 1000.0


def phasors(rig: Rig, first_ns: int, frequency: float = 10.0, duration: float = 1.0) -> np.ndarray:
    """Phasors of the films, from samples of a millisecond; what is no sine is averaged out."""
    times = first_ns + np.arange(0, round(1e9 * duration), MS)
    fit = fit_sine(1e-9 * times, rig.film_voltages(times), frequency)
    return np.asarray(fit.amplitude * np.exp(1j * fit.phase))


def fundamentals(rig: Rig) -> np.ndarray:
    """Fundamentals of the tenth cycle, by Fourier's integral; a fit's trend would take a part of other harmonics."""
    times = SECOND + np.arange(0, 100 * MS, 5000)
    return np.asarray(2 * (rig.film_voltages(times) * np.exp(-20j * np.pi * 1e-9 * times)).mean(axis=1))


# --- generator -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("nominal", [0, 1, 40 * 10**6, 10 * HERTZ, 12_345_678_901, 20_000 * HERTZ])
@pytest.mark.parametrize("bits", [28, 48])
def test_the_generator_gives_the_nearest_frequency_of_its_accumulator(bits: int, nominal: int) -> None:
    step = 25e6 / 2.0**bits
    given = an_effect("frequency_error", bits=bits).frequency(nominal)
    assert given == pytest.approx(round(nominal * 1e-9 / step) * step * 1e9, abs=1 + 1e-13 * nominal)
    assert abs(given - nominal) <= step * 1e9 / 2 + 1


def test_a_fit_of_10_hz_to_28_bits_loses_19_percent_in_10_s_and_no_ratio() -> None:
    true, wrong = (shaken(e, "2", 7e-3, 2.0) for e in ({}, {"frequency_error": an_effect("frequency_error", bits=28)}))
    was, became = (np.abs(phasors(rig, 2 * SECOND, duration=10.0)) for rig in (true, wrong))
    assert became[1] / was[1] - 1 == pytest.approx(-0.19, abs=0.005)
    assert became[0] / became[1] == pytest.approx(was[0] / was[1], rel=1e-12)


# --- limits and inertia --------------------------------------------------------------------------------


def stepped(sample: str, advance: float, amplitude: float, end: float, **limits: float) -> Callable[[Floats], Floats]:
    """Force on the sensor at times, by small steps of the equations of motion."""
    stack = springs.stiffness(scene().design, SAMPLES[sample])
    rail, most, stop = (limits.get(name, np.inf) for name in ("rail", "current", "stop"))
    mass, damping, inductance, wall = 0.03, 2.0, 1e-4, 1e6

    def slope(t: float, y: Floats) -> list[float]:
        current, x, v = y.tolist()
        volts = max(-rail, min(amplitude * math.sin(20 * math.pi * t), rail))
        rise = (volts - RESISTANCE * current - FORCE_CONSTANT * v) / inductance
        if abs(current) >= most and rise * current > 0:
            rise = 0.0
        press = stack * max(x + advance, 0.0) + wall * (max(x - stop, 0.0) + min(x + stop, 0.0))
        return [rise, v, (FORCE_CONSTANT * current - damping * v - SUSPENSION * x - press) / mass]

    solved = scipy.integrate.solve_ivp(slope, (0, end), [0, 0, 0], method="DOP853", rtol=1e-8, atol=1e-11,
                       max_step=4e-5, dense_output=True)  # fmt: skip
    return lambda time: stack * np.maximum(solved.sol(time)[1] + advance, 0.0)


CASES: dict[str, tuple[dict[str, Effect], dict[str, float], float, float]] = {
    "inertia, contact lost": ({}, {}, 1e-3, 5.0),
    "rail": ({"amplifier_clip": an_effect("amplifier_clip", rail="2 V")}, {"rail": 2.0}, 7e-3, 4.0),
    "current": ({"current_limit": an_effect("current_limit", limit="0.4 A")}, {"current": 0.4}, 7e-3, 3.0),
    "stop": ({"end_stops": an_effect("end_stops", travel="2 mm")}, {"stop": 2e-3}, 7e-3, 5.0),
}


@pytest.mark.parametrize("case", CASES)
def test_the_moving_shaker_equals_small_steps(case: str) -> None:
    effects, limits, advance, amplitude = CASES[case]
    rig = shaken({**effects, "shaker_dynamics": an_effect("shaker_dynamics")}, "2", advance, amplitude)
    times = np.arange(0, 60 * MS, 97_003)
    force = rig.cell_force(times)
    expected = stepped("2", advance, amplitude, 0.06, **limits)(1e-9 * times)
    assert np.abs(force - expected).max() < 2e-5 * np.ptp(expected)
    if effects:  # there was something to limit
        free = shaken({"shaker_dynamics": an_effect("shaker_dynamics")}, "2", advance, amplitude)
        assert np.abs(free.cell_force(times) - force).max() > 0.05 * np.ptp(expected)


def test_a_clipped_sine_has_the_fundamental_of_the_book() -> None:
    r = 0.6
    part = 2 / np.pi * (np.arcsin(r) + r * np.sqrt(1 - r**2))
    free = shaken({}, "3", 7e-3, 2.0)
    rail, most = an_effect("amplifier_clip", rail="1.2 V"), an_effect("current_limit", limit=f"{1.2 / RESISTANCE} A")
    for limit in ({"amplifier_clip": rail}, {"current_limit": most}):
        clipped = shaken(limit, "3", 7e-3, 2.0)
        assert fundamentals(clipped) / fundamentals(free) == pytest.approx(part, rel=1e-6)


# --- viscoelastic samples ------------------------------------------------------------------------------


def complex_modulus(g: tuple[float, ...], tau: tuple[float, ...], frequency: float) -> complex:
    """The complex modulus over the slow one."""
    s = 2j * np.pi * frequency
    return 1 + sum(each / (1 - sum(g)) * t * s / (1 + t * s) for each, t in zip(g, tau, strict=True))


@pytest.mark.parametrize("material", PRONY)
@pytest.mark.parametrize("sample", ["1", "2"])
def test_a_creeping_sample_divides_the_force_by_its_complex_modulus(material: str, sample: str) -> None:
    g, tau = PRONY[material]
    elastic, creeping = (
        shaken(e, sample, 7e-3, 1.0) for e in ({}, {"viscoelastic": an_effect("viscoelastic", material=material)})
    )
    was, became = phasors(elastic, 2 * SECOND), phasors(creeping, 900 * SECOND)
    ring, pad = elastic.scene.design.ring, SAMPLES[sample]
    hardness = pad.modulus * ring.height / (ring.material.modulus * pad.thickness)
    share = 1 / (1 + hardness)  # of the object in the compliance of the ring's branch
    e = complex_modulus(g, tau, 10.0)
    ratio = float(abs(was[0] / was[1])) * 68.60e-3 / 5.995e-3
    tooth, rest = ratio * e, (1 - ratio) * e / (share + (1 - share) * e)
    expected = tooth / (tooth + rest)
    assert became[0] / became[1] * 68.60e-3 / 5.995e-3 == pytest.approx(expected, rel=1e-7)
    assert abs(expected) > 1.02 * ratio


# --- hysteresis ----------------------------------------------------------------------------------------


def ratio_raised(effect: dict[str, Effect]) -> list[float]:
    """How an effect raises the ratio of each sample at 3 N."""
    raised = []
    for sample in SAMPLES:
        rigs = (measured(replace(scene(), effects=effects), Question(sample)) for effects in ({}, effect))
        was, became = (np.abs(settled(rig)[:2]) for rig in rigs)
        raised.append(float(became[0] / became[1] / (was[0] / was[1]) - 1))
    return raised


def test_the_default_hysteresis_raises_the_ratio_by_about_a_percent() -> None:
    raised = ratio_raised({"hysteresis": an_effect("hysteresis")})
    assert 0.006 < min(raised) < max(raised) < 0.0185


def test_the_default_rubber_raises_the_ratio_of_its_slow_modulus_by_13_to_16_percent() -> None:
    raised = ratio_raised({"viscoelastic": an_effect("viscoelastic")})
    assert 0.13 < min(raised) < max(raised) < 0.165


# --- what happens to the samples ---------------------------------------------------------------------

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
