"""The physical scene: force by the stack, films and bridge against stepping, and no trace of when one looks."""

from __future__ import annotations

import gc
import itertools
import math
import weakref
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.instrument.models import experiment
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.clock import VirtualClock
from palpate.simulators.effects import effect_class
from palpate.simulators.linear.periodic import CYCLE, HERTZ
from palpate.simulators.rig import Rig
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


def seen(pieces: int, *, looking: bool) -> tuple[bytes, float]:
    """The films after a life with changes at fixed times, waited for in pieces."""
    clock = VirtualClock()
    rig = Rig(scene("charge_amplifier", "gain_scatter"), clock)
    pressed(rig, "5", BALANCE + 3e-3, 1.0)
    for amplitude in (0.5, 2.0, 1.5):
        for _ in range(pieces):
            clock.wait(0.42 / pieces)
            if looking:
                rig.film_voltages(np.array([clock.now_ns()]))
                rig.filtered_cell_force(clock.now_ns())
                rig.cell_force(clock.now_ns() - np.arange(0, SECOND, 100 * MS))
        rig.set_voltage(waveform("sine", amplitude))
    return rig.film_voltages(clock.now_ns() + np.arange(500) * MS).tobytes(), rig.filtered_cell_force(clock.now_ns())


def test_a_wait_cut_into_pieces_with_looks_in_between_gives_the_same_state() -> None:
    assert seen(1, looking=False) == seen(7, looking=True) == seen(420, looking=False)


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


def test_what_was_before_a_change_is_freed_without_the_garbage_collector() -> None:
    clock = VirtualClock()
    rig = Rig(scene("charge_amplifier"), clock)
    clock.add(rig)
    pressed(rig, "2", BALANCE + 8e-3, 0.5)
    chain, path = weakref.ref(rig.chain), weakref.ref(rig.path)
    gc.disable()
    try:
        for number in (1, 2):
            clock.wait(20.0)  # longer than the cell remembers
            rig.set_position(BALANCE + 8e-3 + number * 1e-4)
        assert (chain(), path()) == (None, None)
    finally:
        gc.enable()


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
