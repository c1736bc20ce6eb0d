"""The physical chain against its equations written out: contact, stops, rail, current limit, play operators."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.simulators.effects.viscoelastic import Viscoelastic
from palpate.simulators.linear import path as path_module
from palpate.simulators.linear.lti import gain
from palpate.simulators.linear.path import Path
from palpate.simulators.linear.periodic import HERTZ, SECOND, Periodic, constant
from palpate.simulators.physics.chain import INPUTS, Armature, Limits, MeasuringChain, Plays, SpringStack, Touch

MS = 1_000_000
NO_PLAYS = Plays(ring=False, radii=(), weights=())
FORCE_CONSTANT, RESISTANCE, SUSPENSION = 4.0, 3.5, 1000.0
INDUCTANCE, MASS, DAMPING = 1e-4, 0.03, 2.0
TOOTH, RING = 120.0, 380.0


@dataclass
class Setting:
    advance: float = 2e-3
    volts: float = 2.0
    limits: Limits = field(default_factory=Limits)
    plays: Plays = NO_PLAYS
    moving: bool = False
    creeping: bool = False

    def path(self) -> tuple[MeasuringChain, Path]:
        armature = Armature(FORCE_CONSTANT, RESISTANCE, SUSPENSION)
        if self.moving:
            armature = Armature(FORCE_CONSTANT, RESISTANCE, SUSPENSION, INDUCTANCE, MASS, DAMPING)
        springs = SpringStack(TOOTH, RING, 0.4)
        creep = Viscoelastic.model_validate({"g": [0.3], "tau": ["0.1 s"]})
        stack = creep.stack(springs) if self.creeping else springs.elastic()
        films = gain(np.array([[1.0, 0.0, 1.0, 0.0], [1.0, 1.0, 0.0, 0.0]]))  # tooth with the plays, and total
        chain = MeasuringChain(
            armature, self.limits, stack, self.advance, self.plays, films,
            [gain(np.eye(1)), gain(np.eye(1))], np.zeros(2), 0.1, 0.0,
        )  # fmt: skip
        drive = Periodic(0.0, 10 * HERTZ, 0, 0, np.array([1]), np.array([-1j * self.volts]))
        mode = chain.mode(Touch(contact=(self.advance >= 0,) * 2, drag=(0,) * chain.plays))
        inputs = (drive, constant(1.0, drive), drive.derivative())
        assert len(inputs) == INPUTS
        return chain, Path(inputs, mode, 0, np.zeros(mode.system.order))

    def voltage(self, t: float | Floats) -> Floats:
        volts = self.volts * np.sin(20 * np.pi * np.asarray(t))
        return volts if self.limits.rail is None else np.clip(volts, -self.limits.rail, self.limits.rail)


# --- without inertia: everything is in balance at every moment ------------------------------------------


def balance(setting: Setting, t: Floats) -> tuple[Floats, Floats]:
    """Displacement and force on the stack, by bisection of the balance of forces."""
    current = setting.voltage(t) / RESISTANCE
    if setting.limits.current is not None:
        current = np.clip(current, -setting.limits.current, setting.limits.current)
    stop = math.inf if setting.limits.stop is None else setting.limits.stop

    def left(x: Floats) -> Floats:
        """Force on the armature: it falls as x grows."""
        beyond = np.maximum(np.abs(x) - stop, 0.0) * np.sign(x)
        pressed = (TOOTH + RING) * np.maximum(x + setting.advance, 0.0)
        return FORCE_CONSTANT * current - SUSPENSION * x - setting.limits.stop_stiffness * beyond - pressed

    low, high = np.full(len(t), -0.1), np.full(len(t), 0.1)
    for _ in range(60):
        middle = (low + high) / 2
        up = left(middle) > 0
        low, high = np.where(up, middle, low), np.where(up, high, middle)
    return low, (TOOTH + RING) * np.maximum(low + setting.advance, 0.0)


LIMITS = {
    "contact": (Limits(), 1e-3, 3.0),
    "rail": (Limits(rail=1.5), 4e-3, 2.0),
    "current": (Limits(current=0.4), 4e-3, 2.0),
    "stop": (Limits(stop=1e-3), 4e-3, 3.0),
    "all": (Limits(rail=2.8, current=0.7, stop=1.2e-3), 1e-3, 3.0),
}


@pytest.mark.parametrize("name", LIMITS)
def test_without_inertia_the_chain_is_in_balance_at_every_moment(name: str) -> None:
    limits, advance, volts = LIMITS[name]
    setting = Setting(advance, volts, limits)
    chain, path = setting.path()
    times = np.arange(0, 250 * MS, 99_991)
    x, force = balance(setting, 1e-9 * times)
    found = path.outputs(times, slice(0, None))
    assert np.abs(found[chain.force] - force).max() < 1e-11 * force.max()
    assert np.abs(found[chain.displacement] - x).max() < 1e-11 * np.abs(x).max()
    assert np.abs(found[1] - force).max() < 1e-11 * force.max()
    assert len(path.modes_until(250 * MS)) >= 5


@pytest.mark.parametrize(("ring", "advance", "volts"), [(False, 4e-3, 2.0), (True, 1e-3, 3.0)])
def test_play_operators_follow_their_rule_on_a_fine_grid(ring: bool, advance: float, volts: float) -> None:
    """z <- max(x - r, min(x + r, z)), exact at any step: with loss of contact, and on both paths."""
    plays = Plays(ring, (0.01, 0.05, 0.2), (0.3, 0.2, 0.1))
    setting = Setting(advance, volts, plays=plays)
    _, path = setting.path()
    times = np.arange(0, 350 * MS, 5_000)
    _, force = balance(setting, 1e-9 * times)
    x = force if ring else force * TOOTH / (TOOTH + RING)
    played = np.zeros(len(times))
    for radius, weight in zip(plays.radii, plays.weights, strict=True):
        z, zs = 0.0, np.empty(len(times))
        for k, value in enumerate(x.tolist()):
            z = max(value - radius, min(value + radius, z))
            zs[k] = z
        played += weight * zs
    some = slice(0, None, 101)
    film = path.outputs(times[some], slice(0, 1))[0]
    expected = (force * TOOTH / (TOOTH + RING) + played)[some]
    # Peaks between the points of the grid are missed by up to an eighth of the bend times the step squared.
    assert np.abs(film - expected).max() < 1e-7 * np.abs(expected).max()


def test_zero_drive_on_plays_and_limits_is_no_endless_story() -> None:
    plays = Plays(False, (0.01, 0.05), (0.3, 0.2))
    chain, path = Setting(2e-3, 0.0, Limits(rail=1.0, current=1.0, stop=1e-3), plays).path()
    force = path.outputs(np.array([0, SECOND, 30 * 86_400 * SECOND]), slice(chain.force, chain.force + 1))[0]
    assert force == pytest.approx((TOOTH + RING) * 2e-3 * SUSPENSION / (SUSPENSION + TOOTH + RING), rel=1e-12)
    assert len(path.stretches) < 6


def test_a_creeping_sample_is_followed_until_each_period_is_the_last_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """It creeps for a second and more; taken for settled a period too early, its force would be off by what is left."""
    setting, times = Setting(1e-3, 3.0, creeping=True), 9 * SECOND + np.arange(0, 300) * MS
    _, path = setting.path()
    recurring = path.outputs(times, slice(0, 2))
    assert path.cycle is not None and path.cycle.start_ns > SECOND
    monkeypatch.setattr(path_module, "recurrence", lambda *_: None)
    _, path = setting.path()
    followed = path.outputs(times, slice(0, 2))
    assert path.cycle is None
    # Followed, transitions are of whole nanoseconds: that is 3e-11, in every later period alike.
    assert np.abs(recurring - followed).max() < 1e-10 * np.abs(followed).max()


# --- with inertia --------------------------------------------------------------------------------------


def lived(setting: Setting, until: float) -> tuple[list[float], Callable[[Floats], Floats]]:
    """Times at which something is met or left, and (i, x, v) at any times, from an integrator with events."""
    limits = setting.limits
    stop = math.inf if limits.stop is None else limits.stop
    most = math.inf if limits.current is None else limits.current

    def drawn(t: float, z: Floats) -> float:
        """The current that the voltage would drive through the coil."""
        return (float(setting.voltage(t)) - FORCE_CONSTANT * float(z[2])) / RESISTANCE

    def sides(t: float, z: Floats, held: int) -> tuple[float, ...]:
        """What changes its sign when something is met or left."""
        volts = setting.volts * math.sin(20 * math.pi * t)
        rail = 1.0 if limits.rail is None else abs(volts) - limits.rail
        over = 1.0 if most == math.inf else (held * drawn(t, z) if held else abs(float(z[0]))) - most
        return float(z[1]) + setting.advance, abs(float(z[1])) - stop if stop < math.inf else 1.0, rail, over

    t, z, held = 0.0, np.zeros(3), 0
    times: list[float] = []
    pieces = []
    here = [value > 0 for value in sides(t + 1e-12, z, held)]
    while True:

        def slope(t: float, z: Floats, here: list[bool] = here, held: int = held) -> list[float]:
            i, x, v = (float(each) for each in z)
            volts = setting.volts * math.sin(20 * math.pi * t)
            if limits.rail is not None and here[2]:
                volts = math.copysign(limits.rail, volts)
            push = FORCE_CONSTANT * i - DAMPING * v - SUSPENSION * x
            push -= (TOOTH + RING) * (x + setting.advance) if here[0] else 0.0
            push -= limits.stop_stiffness * (x - math.copysign(stop, x)) if here[1] and stop < math.inf else 0.0
            return [0.0 if held else (volts - RESISTANCE * i - FORCE_CONSTANT * v) / INDUCTANCE, v, push / MASS]

        events = []
        for k in range(4):

            def event(t: float, z: Floats, k: int = k, held: int = held) -> float:
                return sides(t, z, held)[k]

            event.terminal, event.direction = True, -1.0 if here[k] else 1.0  # type: ignore[attr-defined]
            events.append(event)
        done = scipy.integrate.solve_ivp(
            slope, (t, until), z, method="DOP853", rtol=1e-11, atol=1e-13, max_step=2e-4, events=events,
            dense_output=True,
        )  # fmt: skip
        pieces.append((t, done.sol))
        if done.status == 0:
            break
        fired = next(k for k in range(4) if len(done.t_events[k]))
        t, z, here = float(done.t[-1]), done.y[:, -1], [side != (k == fired) for k, side in enumerate(here)]
        if fired == 3:
            held = 0 if held else int(math.copysign(1, z[0]))
        times.append(t)

    starts = np.array([start for start, _ in pieces])

    def at(when: Floats) -> Floats:
        index = np.searchsorted(starts, when, side="right") - 1
        return np.array([pieces[k][1](t) for k, t in zip(index, when, strict=True)]).T

    return times, at


MOVING = {
    "contact": (Limits(), 1e-3, 3.0),
    "rail": (Limits(rail=1.5), 4e-3, 2.0),
    "current": (Limits(current=0.4), 4e-3, 2.0),
    "stop": (Limits(stop=1e-3, stop_stiffness=1e6), 4e-3, 3.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MOVING)
def test_with_inertia_the_chain_meets_and_leaves_its_limits_when_the_integrator_does(name: str) -> None:
    limits, advance, volts = MOVING[name]
    setting = Setting(advance, volts, limits, moving=True)
    chain, path = setting.path()
    until = 0.11
    times, at = lived(setting, until)
    grid = np.arange(1, round(1e3 * until)) * MS
    found = path.outputs(grid, slice(0, None))
    i, x, _ = at(1e-9 * grid)
    assert np.abs(found[chain.displacement] - x).max() < 1e-8 * np.abs(x).max()
    assert np.abs(found[chain.current] - i).max() < 1e-8 * np.abs(i).max()
    stays = path.between(0, round(until * 1e9))
    starts = [after.start_ns for before, after in itertools.pairwise(stays) if after.mode is not before.mode]
    assert len(starts) == len(times) >= 2
    assert np.abs(np.array(starts) - 1e9 * np.array(times)).max() < 2
