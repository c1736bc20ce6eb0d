"""The physical scene: force by the stack, films and bridge against stepping, and no trace of when one looks."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import BenchError
from palpate.instrument.models import experiment
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.sensor_node import SimulatedSensorNode
from palpate.simulators.effects import effect_class
from palpate.simulators.linear.periodic import CYCLE, HERTZ
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.rig import SUPPORT_STIFFNESS, Rig
from tests.simulators.rigs import BALANCE, MS, SECOND, pressed, scene, share, waveform

Times = npt.NDArray[np.int64]


# --- the films against brute force ---------------------------------------------------------------------


@dataclass
class Story:
    """What happens to the bench, told to the rig and to an integrator that knows no closed form."""

    rig: Rig
    clock: VirtualClock
    tau: float
    amplitude: float = 0.0
    frequency: float = 10.0
    turned: float = 0.0  # cycles at the last change
    since_ns: int = 0
    position: float = 0.0
    sample: str = "2"
    gains: Floats = field(default_factory=lambda: np.zeros(2))  # V per N of coil and suspension together
    drained: Floats = field(default_factory=lambda: np.zeros(2))  # the charge, in volts, that has leaked

    def change(self, **what: float | str) -> None:
        """Carry the phase on, take the new settings, and tell the rig."""
        now = self.clock.now_ns()
        self.turned = (self.turned + self.frequency * 1e-9 * (now - self.since_ns)) % 1
        self.since_ns = now
        for name, value in what.items():
            setattr(self, name, value)
        if "sample" in what:
            self.rig.mount(SAMPLES[self.sample])
        if "position" in what:
            self.rig.set_position(self.position)
        ratio = experiment.force_ratio(self.rig.scene.design, SAMPLES[self.sample])
        self.gains = share(self.rig.scene, self.sample) * np.array([5.995e-3 * ratio, 68.60e-3])
        assert 4.0 / 3.5 * self.amplitude <= 1000.0 * abs(self.position - BALANCE), "the story keeps contact"
        if {"amplitude", "frequency"} & set(what):
            drive = waveform("sine", self.amplitude, round(HERTZ * self.frequency), now)
            self.rig.set_voltage(replace(drive, start_phase=round(self.turned * CYCLE)))

    def charge(self, t: npt.ArrayLike) -> Floats:
        """Film charges as voltages, t s after the last change: shape (2, n)."""
        volts = self.amplitude * np.sin(2 * np.pi * (self.turned + self.frequency * np.atleast_1d(t)))
        return np.outer(self.gains, 4.0 / 3.5 * volts + 1000.0 * (self.position - BALANCE))

    def live(self, duration: float, times: int = 200) -> float:
        """Integrate over `duration`, wait, and give the largest difference to the rig in V."""
        grid = np.round(np.linspace(0, duration, times) * 1e9).astype(np.int64)
        solved = scipy.integrate.solve_ivp(
            lambda t, x: (self.charge(t)[:, 0] - x) / self.tau,
            (0, 1e-9 * grid[-1]),
            self.drained,
            method="DOP853",
            t_eval=1e-9 * grid,
            rtol=1e-12,
            atol=1e-15,
            max_step=0.02,
        )
        stepped = self.charge(1e-9 * grid) - solved.y
        difference = np.abs(self.rig.film_voltages(self.since_ns + grid) - stepped).max()
        self.drained = solved.y[:, -1]
        self.clock.wait(duration)
        return float(difference)


@pytest.mark.parametrize("tau", [0.05, 1.0, 300.0])
def test_charge_amplifier_outputs_equal_stepping_through_every_kind_of_change(tau: float) -> None:
    clock = VirtualClock()
    chosen = scene("charge_amplifier")
    slow = effect_class("charge_amplifier").model_validate({"time_constant": f"{tau} s"})
    rig = Rig(replace(chosen, effects={"charge_amplifier": slow}), clock)
    story = Story(rig, clock, tau)
    story.change(sample="2")
    story.change(position=BALANCE + 4e-3)
    differences = [story.live(0.3)]
    for what in (
        {"amplitude": 2.5},
        {"frequency": 12.345},
        {"amplitude": 1.25, "frequency": 3.0},
        {"position": BALANCE + 7e-3},
        {"sample": "4"},
        {"position": BALANCE + 5e-3, "amplitude": 3.0},
        {"amplitude": 0.0},
    ):
        story.change(**what)
        differences.append(story.live(0.277_777_7))
    assert max(differences) < 1e-9
    assert np.abs(story.drained).max() > 1e-4  # there was something to get wrong


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
