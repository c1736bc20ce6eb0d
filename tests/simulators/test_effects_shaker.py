"""Generator, shaker and sample against closed formulas and brute force that knows nothing of the chain."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.instrument.models import springs
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.signals.estimate import fit_sine
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects.amplifier_clip import AmplifierClip
from palpate.simulators.effects.current_limit import CurrentLimit
from palpate.simulators.effects.end_stops import EndStops
from palpate.simulators.effects.frequency_error import FrequencyError
from palpate.simulators.effects.hysteresis import Hysteresis
from palpate.simulators.effects.shaker_dynamics import ShakerDynamics
from palpate.simulators.effects.viscoelastic import PRONY, Viscoelastic
from palpate.simulators.linear.periodic import HERTZ
from palpate.simulators.physics.effect import Effect
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.plan import driven as measured
from palpate.simulators.planning.plan import phasors as settled
from palpate.simulators.rig import Rig
from tests.simulators.rigs import BALANCE, MS, SECOND, pressed, scene

FORCE_CONSTANT, RESISTANCE, SUSPENSION = 4.0, 3.5, 1000.0


def driven(effects: Mapping[str, Effect], sample: str, advance: float, amplitude: float) -> Rig:
    rig = Rig(replace(scene(), effects=effects), VirtualClock())
    pressed(rig, sample, BALANCE + advance, amplitude)
    return rig


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
    given = FrequencyError(bits=bits).frequency(nominal)
    assert given == pytest.approx(round(nominal * 1e-9 / step) * step * 1e9, abs=1 + 1e-13 * nominal)
    assert abs(given - nominal) <= step * 1e9 / 2 + 1


def test_28_bits_give_9_9652_hz_for_10() -> None:
    assert FrequencyError(bits=28).frequency(10 * HERTZ) == pytest.approx(9.9652 * HERTZ, abs=5e-5 * HERTZ)


def test_a_fit_of_10_hz_to_28_bits_loses_19_percent_in_10_s_and_no_ratio() -> None:
    true, wrong = (driven(e, "2", 7e-3, 2.0) for e in ({}, {"frequency_error": FrequencyError(bits=28)}))
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
    "rail": ({"amplifier_clip": AmplifierClip(rail="2 V")}, {"rail": 2.0}, 7e-3, 4.0),
    "current": ({"current_limit": CurrentLimit(limit="0.4 A")}, {"current": 0.4}, 7e-3, 3.0),
    "stop": ({"end_stops": EndStops(travel="2 mm")}, {"stop": 2e-3}, 7e-3, 5.0),
}


@pytest.mark.parametrize("case", CASES)
def test_the_moving_shaker_equals_small_steps(case: str) -> None:
    effects, limits, advance, amplitude = CASES[case]
    rig = driven({**effects, "shaker_dynamics": ShakerDynamics()}, "2", advance, amplitude)
    times = np.arange(0, 60 * MS, 97_003)
    force = rig.cell_force(times)
    expected = stepped("2", advance, amplitude, 0.06, **limits)(1e-9 * times)
    assert np.abs(force - expected).max() < 2e-5 * np.ptp(expected)
    if effects:  # there was something to limit
        free = driven({"shaker_dynamics": ShakerDynamics()}, "2", advance, amplitude)
        assert np.abs(free.cell_force(times) - force).max() > 0.05 * np.ptp(expected)


def test_a_clipped_sine_has_the_fundamental_of_the_book() -> None:
    r = 0.6
    part = 2 / np.pi * (np.arcsin(r) + r * np.sqrt(1 - r**2))
    free = driven({}, "3", 7e-3, 2.0)
    rail, most = AmplifierClip(rail="1.2 V"), CurrentLimit(limit=f"{1.2 / RESISTANCE} A")
    for limit in ({"amplifier_clip": rail}, {"current_limit": most}):
        clipped = driven(limit, "3", 7e-3, 2.0)
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
    elastic, creeping = (driven(e, sample, 7e-3, 1.0) for e in ({}, {"viscoelastic": Viscoelastic(material=material)}))
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


def test_a_creeping_sample_relaxes_as_small_steps_do() -> None:
    """Object and ring in series, one Maxwell arm in the object; the armature presses by its suspension."""
    g, tau, sample = 0.4, 0.05, "3"
    rig = driven({"viscoelastic": Viscoelastic(g=(g,), tau=(f"{tau} s",))}, sample, 5e-3, 0.0)
    stiffness = springs.stiffness(rig.scene.design, SAMPLES[sample])
    ratio = float(np.abs(phasors(driven({}, sample, 7e-3, 1.0), 0)) @ [68.60e-3 / 5.995e-3, 0]) / float(
        np.abs(phasors(driven({}, sample, 7e-3, 1.0), 0))[1]
    )
    ring, pad = rig.scene.design.ring, SAMPLES[sample]
    share = 1 / (1 + pad.modulus * ring.height / (ring.material.modulus * pad.thickness))
    tooth, branch = ratio * stiffness, (1 - ratio) * stiffness
    over_ring, own_ring = branch / share, branch / (1 - share)  # object and ring as springs in series
    fast = g / (1 - g)

    def forces(y: Floats) -> tuple[float, float]:
        """The arms hold tooth * fast * (u - y0) and over_ring * fast * (w - y1); in balance with the suspension."""
        # Unknown: compression u of the stack, w of the object over the ring.
        a = np.array(
            [
                [tooth * (1 + fast) + SUSPENSION, over_ring * (1 + fast)],
                [-own_ring, over_ring * (1 + fast) + own_ring],
            ]
        )
        b = np.array([SUSPENSION * 5e-3 + tooth * fast * y[0] + over_ring * fast * y[1], over_ring * fast * y[1]])
        u, w = np.linalg.solve(a, b)
        return float(u), float(w)

    solved = scipy.integrate.solve_ivp(lambda t, y: (np.array(forces(y)) - y) / tau, (0, 0.4), [0, 0], method="DOP853",
                       rtol=1e-11, atol=1e-16, dense_output=True)  # fmt: skip
    times = np.arange(0, 400 * MS, 3 * MS)
    expected = []
    for y in solved.sol(1e-9 * times).T:
        u, w = forces(y)
        expected.append([tooth * (u + fast * (u - y[0])), over_ring * (w + fast * (w - y[1]))])
    on_tooth, on_ring = np.array(expected).T
    films = rig.film_voltages(times)
    assert films[0] == pytest.approx(5.995e-3 * on_tooth, rel=1e-8)
    assert films[1] == pytest.approx(68.60e-3 * (on_tooth + on_ring), rel=1e-8)
    assert np.ptp(films[1]) > 0.05 * films[1, -1]


# --- hysteresis ----------------------------------------------------------------------------------------


def played(force: Floats, radii: tuple[float, ...], weights: tuple[float, ...]) -> Floats:
    """Sample by sample, from rest."""
    total = force.copy()
    for radius, weight in zip(radii, weights, strict=True):
        z = 0.0
        for k, x in enumerate(force):
            z = max(x - radius, min(x + radius, z))
            total[k] += weight * z
    return total


def ratio_raised(effect: dict[str, Effect]) -> list[float]:
    """How an effect raises the ratio of each sample at 3 N."""
    raised = []
    for sample in SAMPLES:
        rigs = (measured(replace(scene(), effects=effects), Question(sample)) for effects in ({}, effect))
        was, became = (np.abs(settled(rig)[:2]) for rig in rigs)
        raised.append(float(became[0] / became[1] / (was[0] / was[1]) - 1))
    return raised


def test_the_default_hysteresis_raises_the_ratio_by_about_a_percent() -> None:
    raised = ratio_raised({"hysteresis": Hysteresis()})
    assert 0.006 < min(raised) < max(raised) < 0.0185


def test_the_default_rubber_raises_the_ratio_of_its_slow_modulus_by_13_to_16_percent() -> None:
    raised = ratio_raised({"viscoelastic": Viscoelastic()})
    assert 0.13 < min(raised) < max(raised) < 0.165
