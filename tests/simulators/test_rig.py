"""The physical scene: force by the stack, films and bridge against stepping, and no trace of when one looks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import BenchError
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.linear.periodic import HERTZ
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.rig import SUPPORT_STIFFNESS, Rig
from tests.simulators.rigs import BALANCE, MS, SECOND, an_effect, pressed, scene, shaken, share, waveform

Times = npt.NDArray[np.int64]


# --- the films against brute force ---------------------------------------------------------------------


def turned(amplitude: float, frequency: float = 10.0) -> Callable[[Rig], None]:
    return lambda rig: rig.set_voltage(waveform("sine", amplitude, round(HERTZ * frequency), rig.clock.now_ns()))


CHANGES: dict[str, Callable[[Rig], None]] = {  # all keep contact
    "none": lambda _: None,
    "amplitude": turned(2.5),
    "frequency": turned(2.5, 12.345),
    "both": turned(1.25, 3.0),
    "position": lambda rig: rig.set_position(BALANCE + 7e-3),
    "sample": lambda rig: rig.mount(SAMPLES["4"]),
    "less room": lambda rig: rig.set_position(BALANCE + 5e-3),
    "more force": turned(3.0),
    "rest": turned(0.0),
}


@pytest.mark.parametrize("tau", [0.05, 1.0, 300.0])
def test_charge_amplifier_outputs_are_what_leaks_through_every_kind_of_change(tau: float) -> None:
    """The charge is that of a bench without amplifiers; what has leaked is summed up by Gauss' rule in 10 ms each."""
    amplifier = an_effect("charge_amplifier", time_constant=f"{tau} s")
    bare, rig = (shaken(effects, "2", 4e-3, 0.0) for effects in ({}, {"charge_amplifier": amplifier}))
    nodes, weights = np.polynomial.legendre.leggauss(16)
    leaked = np.zeros(2)
    for name, change in CHANGES.items():
        change(bare)
        change(rig)
        for start in rig.clock.now_ns() + 10 * MS * np.arange(27):
            exact = start + 5 * MS * (1 + nodes)
            at, end = np.round(exact).astype(np.int64), np.array([start + 10 * MS])
            charge = bare.film_voltages(at) + 1e-9 * (exact - at) * bare.film_rates(at)
            leaked = (
                leaked * math.exp(-0.01 / tau) + charge * np.exp(-1e-9 * (end - exact) / tau) @ weights * 5e-3 / tau
            )
            expected = bare.film_voltages(end)[:, 0] - leaked
            assert rig.film_voltages(end)[:, 0] == pytest.approx(expected, abs=1e-9), name
        bare.clock.wait(0.27)
        rig.clock.wait(0.27)
    assert np.abs(leaked).max() > 1e-4  # there was something to get wrong


def test_the_bridge_filter_equals_stepping_when_load_and_filter_change() -> None:
    clock = VirtualClock()
    rig = Rig(scene(), clock)
    pressed(rig, "1", BALANCE + 5e-3, 2.0)
    part, tau, static, x = share(rig.scene, "1"), 0.1, 5.0 * share(rig.scene, "1"), 0.0

    def slope(t: float, y: Floats) -> Floats:
        swing = part * 2.0 * 4.0 / 3.5 * math.sin(20 * math.pi * t)
        return np.asarray((static + swing - y) / tau)

    for number in range(4):
        if number == 1:
            rig.set_position(BALANCE + 6e-3)
            static += 1.0 * part
        elif number == 2:
            tau = 0.033
            rig.set_bridge_filter(tau)
        elif number == 3:
            rig.place_weight(0.44)
            static += 0.44 * 9.80665
        span = (number * 0.33, (number + 1) * 0.33)
        x = float(
            scipy.integrate.solve_ivp(slope, span, [x], method="DOP853", rtol=1e-12, atol=1e-14, max_step=0.02).y[0, -1]
        )
        clock.wait(0.33)
        assert rig.filtered_cell_force(clock.now_ns()) == pytest.approx(x, abs=1e-9)


# --- looking does not change anything ------------------------------------------------------------------


def test_a_second_change_at_the_same_moment_replaces_the_first() -> None:
    rigs = [Rig(scene("charge_amplifier", "gain_scatter"), VirtualClock()) for _ in range(2)]
    for rig, amplitudes in zip(rigs, ((2.0,), (5.0, 0.1, 2.0)), strict=True):
        rig.mount(SAMPLES["2"])
        rig.set_position(BALANCE + 5e-3)
        for amplitude in amplitudes:
            rig.set_voltage(waveform("sine", amplitude))
    times = np.arange(0, SECOND, 7 * MS)
    assert rigs[0].film_voltages(times).tobytes() == rigs[1].film_voltages(times).tobytes()
    assert len(rigs[1].paths) == 1


def test_the_cell_remembers_the_last_ten_seconds_across_changes() -> None:
    clock = VirtualClock()
    rig = Rig(scene(), clock)
    pressed(rig, "2", BALANCE + 8e-3, 0.5)
    written: list[tuple[Times, Floats]] = []
    for amplitude in itertools.chain(np.linspace(0.5, 3.0, 60)):
        rig.set_voltage(waveform("sine", float(amplitude)))
        times = clock.now_ns() + np.arange(0, 250 * MS, 13 * MS)
        written.append((times, rig.cell_force(times)))
        clock.wait(0.25)
    times = np.concatenate([t for t, _ in written[-40:]])
    force = np.concatenate([f for _, f in written[-40:]])
    assert rig.cell_force(times).tobytes() == force.tobytes()
    assert len(rig.paths) < 52  # and no more than it has to


def test_only_a_drive_that_drives_is_a_change() -> None:
    rig = Rig(scene(), VirtualClock())
    nothing = waveform("sine", 0.0, 20 * HERTZ, 0)
    changes = rig.changes
    rig.set_voltage(nothing)
    assert rig.changes == changes
    for drive in (replace(nothing, mean=0.5), nothing, waveform("sine", 1.0, 20 * HERTZ, 0), nothing):
        rig.set_voltage(drive)
        changes += 1
        assert rig.changes == changes


# --- the force on the sample -------------------------------------------------------------------------


def force_over_a_cycle(sample: str, position: float, amplitude: float, kind: str = "sine") -> tuple[Floats, Floats]:
    """The rig's force, and what it would be without loss of contact."""
    chosen = scene()
    rig = Rig(chosen, VirtualClock())
    pressed(rig, sample, position, amplitude, kind)
    times = np.arange(0, 100 * MS, 50_021)
    drive = waveform(kind, amplitude).at(times) * chosen.rig.force_constant / chosen.rig.coil_resistance
    preload = chosen.rig.suspension_stiffness * (position - BALANCE)
    return rig.cell_force(times), share(chosen, sample) * (drive + preload)


@pytest.mark.parametrize(("kind", "sample"), [("sine", "1"), ("triangle", "2"), ("square", "1")])
def test_where_contact_is_lost_the_force_is_clipped_at_zero(kind: str, sample: str) -> None:
    lost = 0
    for position in np.linspace(BALANCE - 6e-3, BALANCE + 7e-3, 14):
        force, linear = force_over_a_cycle(sample, float(position), 5.0, kind)
        assert np.abs(force - np.maximum(linear, 0)).max() < 1e-12 * np.ptp(linear)
        lost += bool((linear < 0).any() and (linear > 0).any())
    assert lost > 8


# --- the rigid support -------------------------------------------------------------------------------

SUSPENSION = 1000.0  # N/m


@pytest.mark.parametrize("sample", ["1", "2", None])
def test_the_force_is_that_of_suspension_sample_and_support_in_series(sample: str | None) -> None:
    rig = Rig(scene(), VirtualClock())
    pad = None if sample is None else SAMPLES[sample]
    rig.lay_on_support(pad)
    contact = BALANCE if pad else BALANCE + 3e-3
    yielding = 1 / SUSPENSION + 1 / SUPPORT_STIFFNESS + (pad.thickness / (pad.modulus * pad.area) if pad else 0.0)
    now = np.array([0])
    for advance in (-1e-3, 0.0, 1e-3, 4e-3):
        rig.set_position(contact + advance)
        assert rig.cell_force(now)[0] == pytest.approx(max(advance, 0.0) / yielding, abs=1e-12)
        assert (rig.film_voltages(now) == 0).all()


def test_a_sample_on_the_sensor_is_felt_again_after_the_support() -> None:
    rig = Rig(scene(), VirtualClock())
    rig.lay_on_support(SAMPLES["1"])
    rig.mount(SAMPLES["1"])
    rig.set_position(BALANCE + 2e-3)
    assert (rig.film_voltages(np.array([0])) > 0).all()


def test_nobody_reaches_under_a_lowered_probe(sim: SimulatedBench) -> None:
    sim.rig.set_position(5e-3)
    with pytest.raises(BenchError, match="the probe stands at 5 mm: move it home before"):
        sim.operator.lay_on_support(None)


# --- a month later -----------------------------------------------------------------------------------

MONTH = 30 * 86_400
PRESSED = 2e-3  # m: tissue creeps away from a probe that merely touches it


@pytest.mark.slow
@pytest.mark.parametrize("name", ["noisy_lab", "humid_body", "long_drift"])
def test_a_second_of_samples_after_30_days_costs_no_more_than_the_changes_before(name: str) -> None:
    clock, chosen = VirtualClock(), read_scene(name)
    rig = Rig(chosen, clock)
    clock.add(rig)
    pressed(rig, "2", chosen.rig.sensor_position + PRESSED, 1.0)
    clock.wait(MONTH)
    assert rig.changes <= 3 + 1000  # of a leak that creeps in by 1000 parts
    times = MONTH * SECOND + MS * np.arange(1, 1001)
    whole, pieces = SimulatedSensorNode(clock, 1, 1, rig), SimulatedSensorNode(clock, 1, 1, rig)

    def counts(node: SimulatedSensorNode, some: np.ndarray[tuple[int], np.dtype[np.int64]]) -> bytes:
        return node.sample(some, node.film_channels @ rig.film_voltages(some, MS), MS).counts.tobytes()

    taken = counts(whole, times)
    assert b"".join(counts(pieces, times[at : at + 333]) for at in range(0, 1000, 333)) == taken
    # What is left after a month is the steady state: one sine of the drive's own frequency.
    films = rig.film_voltages(times, MS)
    frequency = rig.coil_voltage().frequency / HERTZ
    phasors = 2 * (films - films.mean(axis=1, keepdims=True)) @ np.exp(-2e-9j * np.pi * frequency * (times - times[0]))
    assert np.abs(phasors) / len(times) == pytest.approx(np.abs(rig.transfer(frequency)[:-1]), rel=1e-6)
