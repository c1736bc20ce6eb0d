"""Amplifiers and leaks against the network's own equations, integrated without the chain."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.effects import humidity_leak
from palpate.simulators.effects.charge_amplifier import ChargeAmplifier
from palpate.simulators.effects.humidity_leak import HumidityLeak
from palpate.simulators.effects.voltage_amplifier import VoltageAmplifier
from palpate.simulators.physics.effect import Effect
from palpate.simulators.rig import Rig
from tests.simulators.rigs import BALANCE, MS, SECOND, pressed, scene

DISC, SQUARE, CABLE = 26e-12, 425e-12, 100e-12


def driven(effects: Mapping[str, Effect]) -> tuple[VirtualClock, Rig]:
    clock = VirtualClock()
    rig = Rig(replace(scene(), effects=effects), clock)
    clock.add(rig)
    pressed(rig, "2", BALANCE + 7e-3, 2.0)
    return clock, rig


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
    _, bare = driven({})
    _, rig = driven({"voltage_amplifier": VoltageAmplifier(resistance=resistance)})
    ohms = VoltageAmplifier(resistance=resistance).resistance
    times = np.arange(0, 400 * MS, MS)
    (amplitudes, preload), films = unit(bare), rig.film_voltages(times)
    t = 1e-9 * times
    for number, capacitance in enumerate((DISC, SQUARE)):
        waves = network(capacitance, lambda _: 1 / ohms, 0.4)(t)
        steps = capacitance / (capacitance + CABLE) * np.exp(-t / (ohms * (capacitance + CABLE)))
        expected = amplitudes[number] * ((waves - steps) + preload * steps)
        assert films[number] == pytest.approx(expected, rel=1e-7, abs=1e-7 * amplitudes[number])


def test_cables_take_74_to_94_percent_of_the_film_under_the_tooth() -> None:
    _, bare = driven({})
    for cable, lost in (("74 pF", 0.74), ("100 pF", 0.794), ("407 pF", 0.94)):
        _, rig = driven({"voltage_amplifier": VoltageAmplifier(cable=cable, resistance="1 Tohm")})
        times = SECOND + np.arange(0, 100 * MS, MS)
        left = np.ptp(rig.film_voltages(times), axis=1) / np.ptp(bare.film_voltages(times), axis=1)
        assert left[0] == pytest.approx(1 - lost, abs=2e-3)
        assert left[1] > left[0]  # the ratio changes too


@pytest.mark.slow
def test_a_leak_across_a_voltage_amplifier_drains_as_the_changing_network_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(humidity_leak, "EPOCHS", 300)
    leak = HumidityLeak(dry="1 Tohm", wet="1 Gohm", over="2 s")
    clock, rig = driven({"voltage_amplifier": VoltageAmplifier(), "humidity_leak": leak})
    _, bare = driven({})
    amplitudes, preload = unit(bare)
    # Preload and sine by superposition: the network is linear in both.
    exact = network(DISC, lambda t: 1e-9 + leak.conductance(t), 2.0)
    step = scipy.integrate.solve_ivp(
        lambda t, v: -(1e-9 + leak.conductance(t)) / (DISC + CABLE) * v, (0, 2.0), [DISC / (DISC + CABLE)],
        method="DOP853", rtol=1e-10, atol=1e-16, dense_output=True,
    )  # fmt: skip
    worst = 0.0
    for moment in (0.25, 1.0, 1.8):
        clock.wait(moment - 1e-9 * clock.now_ns())
        times = np.array([clock.now_ns()])
        waves, steps = exact(1e-9 * times), step.sol(1e-9 * times)[0]
        expected = amplitudes[0] * ((waves - steps) + preload * steps)
        worst = max(worst, float(np.abs(rig.film_voltages(times)[0] - expected).max() / amplitudes[0]))
    assert worst < 1e-3  # epochs of 7 ms in which the leak stands still


def test_a_leak_before_a_charge_amplifier_gives_an_offset_and_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(humidity_leak, "EPOCHS", 50)
    leak = HumidityLeak(dry="1 Tohm", wet="100 Mohm", over="1 s")
    (clock, wet), (other, dry) = (
        driven({"charge_amplifier": ChargeAmplifier(), "humidity_leak": leak}),
        driven({"charge_amplifier": ChargeAmplifier()}),
    )
    for each in (clock, other):
        each.wait(1.5)
    times = clock.now_ns() + np.arange(0, 300 * MS, MS)
    offset = 1e-3 * 1e9 / 1e8  # input offset times feedback over leak
    assert wet.film_voltages(times) - dry.film_voltages(times) == pytest.approx(np.full((2, 300), offset), rel=1e-9)


def test_a_leak_has_the_resistances_that_it_begins_and_ends_with_and_falls_by_equal_parts() -> None:
    leak = HumidityLeak()
    assert [1 / leak.conductance(t) for t in (0.0, 1800.0, 3600.0, 1e9)] == pytest.approx([1e12, 1e10, 1e8, 1e8])


def test_a_leak_that_has_ended_changes_nothing_any_more_in_30_days(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(humidity_leak, "EPOCHS", 50)
    clock, rig = driven({"charge_amplifier": ChargeAmplifier(), "humidity_leak": HumidityLeak(over="1 s")})
    clock.wait(2.0)
    begun = rig.path
    clock.wait(30 * 86_400.0)
    assert rig.path is begun


def test_a_leak_without_an_amplifier_that_loads_the_film_never_begins_anything_anew() -> None:
    clock, rig = driven({"humidity_leak": HumidityLeak(wet="1 Mohm", over="1 s")})
    begun = rig.path
    assert rig.next_event_ns() == NEVER
    clock.wait(0.5)
    assert rig.path is begun
    times = 400 * MS + np.arange(0, 100 * MS, MS)
    assert rig.film_voltages(times).tobytes() == driven({})[1].film_voltages(times).tobytes()
