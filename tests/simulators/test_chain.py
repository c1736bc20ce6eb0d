"""The physical chain against its equations written out: contact, stops, rail, current limit, play operators."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.simulators.linear import path as path_module
from palpate.simulators.linear.lti import gain
from palpate.simulators.linear.path import Path
from palpate.simulators.linear.periodic import HERTZ, SECOND, Periodic, constant
from palpate.simulators.physics.chain import INPUTS, Armature, Limits, MeasuringChain, Plays, SpringStack, Touch
from tests.simulators.rigs import an_effect

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
        creep = an_effect("viscoelastic", g=[0.3], tau=["0.1 s"])
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
