"""The physical chain against its equations written out: contact, stops, rail, current limit, play operators."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.simulators.clock import VirtualClock
from palpate.simulators.linear import path as path_module
from palpate.simulators.linear.lti import StateSpace
from palpate.simulators.linear.path import Path
from palpate.simulators.linear.periodic import HERTZ, SECOND
from palpate.simulators.physics.chain import Armature, Limits, MeasuringChain, Plays, SpringStack
from palpate.simulators.rig import Rig
from tests.simulators.rigs import BALANCE, MS, NO_PLAYS, an_effect, chain_on, pressed, scene

FORCE_CONSTANT, RESISTANCE, SUSPENSION = 4.0, 3.5, 1000.0
TOOTH, RING = 120.0, 380.0


@dataclass
class Setting:
    advance: float = 2e-3
    volts: float = 2.0
    limits: Limits = field(default_factory=Limits)
    plays: Plays = NO_PLAYS
    creeping: bool = False

    def path(self) -> tuple[MeasuringChain, Path]:
        springs = SpringStack(TOOTH, RING, 0.4)
        creep = an_effect("viscoelastic", g=[0.3], tau=["0.1 s"])
        stack = creep.stack(springs) if self.creeping else springs.elastic()
        return chain_on(stack, self.advance, self.volts, limits=self.limits, plays=self.plays)

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

INDUCTANCE, MASS, DAMPING = 1e-4, 0.03, 2.0
ALWAYS_PRESSED, DRIVE = 4e-3, 2.0  # m, V


def lived(limits: Limits, until: float) -> tuple[list[float], Callable[[Floats], Floats]]:
    """Times at which the rail or the current's limit acts or ends, and (i, x, v) at any times, by an integrator."""
    rail, most = limits.rail or math.inf, limits.current or math.inf

    def volts(t: float) -> float:
        return DRIVE * math.sin(20 * math.pi * t)

    def sides(t: float, z: Floats, held: int) -> tuple[float, float]:
        """What changes its sign when a limit acts or ends; a held current ends where the voltage would drive less."""
        drawn = (volts(t) - FORCE_CONSTANT * float(z[2])) / RESISTANCE
        return abs(volts(t)) - rail, (held * drawn if held else abs(float(z[0]))) - most

    t, z, held = 0.0, np.zeros(3), 0
    times, pieces = list[float](), []
    here = [False, False]
    while True:

        def slope(t: float, z: Floats, here: list[bool] = here, held: int = held) -> list[float]:
            i, x, v = (float(each) for each in z)
            applied = math.copysign(rail, volts(t)) if here[0] else volts(t)
            push = FORCE_CONSTANT * i - DAMPING * v - SUSPENSION * x - (TOOTH + RING) * (x + ALWAYS_PRESSED)
            return [0.0 if held else (applied - RESISTANCE * i - FORCE_CONSTANT * v) / INDUCTANCE, v, push / MASS]

        events = []
        for k in range(2):

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
        fired = next(k for k in range(2) if len(done.t_events[k]))
        t, z, here = float(done.t[-1]), done.y[:, -1], [side != (k == fired) for k, side in enumerate(here)]
        if fired == 1:
            held = 0 if held else int(math.copysign(1, z[0]))
        times.append(t)

    starts = np.array([start for start, _ in pieces])

    def at(when: Floats) -> Floats:
        index = np.searchsorted(starts, when, side="right") - 1
        return np.array([pieces[k][1](t) for k, t in zip(index, when, strict=True)]).T

    return times, at


@pytest.mark.slow
@pytest.mark.parametrize("limits", [Limits(rail=1.5), Limits(current=0.4)], ids=["rail", "current"])
def test_with_inertia_the_rail_and_the_current_are_met_and_left_when_the_integrator_does(limits: Limits) -> None:
    """Contact and end stop with inertia: `tests/test_hard_cases.py`."""
    armature = Armature(FORCE_CONSTANT, RESISTANCE, SUSPENSION, INDUCTANCE, MASS, DAMPING)
    stack = SpringStack(TOOTH, RING, 0.4).elastic()
    chain, path = chain_on(stack, ALWAYS_PRESSED, DRIVE, armature=armature, limits=limits)
    times, at = lived(limits, 0.11)
    grid = np.arange(1, 110) * MS
    found = path.outputs(grid, slice(0, None))
    i, x, _ = at(1e-9 * grid)
    assert np.abs(found[chain.displacement] - x).max() < 1e-8 * np.abs(x).max()
    assert np.abs(found[chain.current] - i).max() < 1e-8 * np.abs(i).max()
    stays = path.between(0, round(0.11e9))
    starts = [after.start_ns for before, after in itertools.pairwise(stays) if after.mode is not before.mode]
    assert len(starts) == len(times) >= 2
    assert np.abs(np.array(starts) - 1e9 * np.array(times)).max() < 2


# --- samples that creep ------------------------------------------------------------------------------

FINE = 400  # samples of a period
OUTPUTS = 2  # films before the bridge: the force on the tooth, and on the ring


@dataclass(frozen=True)
class Drawn:
    """A shaker on a sample that creeps, from fresh."""

    creep: tuple[tuple[float, float], ...]  # shares and time constants [s]
    tooth: float
    ring: float
    share: float
    advance: float
    volts: float
    frequency: int
    moving: bool
    stop: float | None
    radii: tuple[float, ...]

    def stack(self) -> StateSpace:
        g, tau = zip(*self.creep, strict=True)
        creep = an_effect("viscoelastic", g=g, tau=[f"{each!r} s" for each in tau])
        return creep.stack(SpringStack(self.tooth, self.ring, self.share))

    def path(self) -> tuple[MeasuringChain, Path]:
        inertia = (1e-4, 0.03, 2.0) if self.moving else ()
        return chain_on(
            self.stack(), self.advance, self.volts, self.frequency,
            armature=Armature(FORCE_CONSTANT, RESISTANCE, SUSPENSION, *inertia), limits=Limits(stop=self.stop),
            plays=Plays(False, self.radii, (0.1,) * len(self.radii)), films=np.eye(4)[:OUTPUTS],
        )  # fmt: skip


def scene_of(seed: int) -> Drawn:
    draw = Random(seed)
    return Drawn(
        creep=tuple((draw.uniform(0.01, 0.45), 10.0 ** draw.uniform(-4, 1)) for _ in range(draw.randint(1, 2))),
        tooth=draw.uniform(20, 500),
        ring=draw.uniform(20, 500),
        share=draw.uniform(0.05, 0.95),
        advance=draw.uniform(-2e-3, 5e-3),
        volts=draw.uniform(1, 6),
        frequency=draw.choice([HERTZ, 10 * HERTZ, 37 * HERTZ]),
        moving=draw.random() < 0.5,
        stop=draw.choice([None, 1e-3, 3e-3]),
        radii=draw.choice([(), (0.01,), (0.05, 0.2)]),
    )


LOST = Drawn(((0.3, 0.02),), 120.0, 380.0, 0.4, 1e-3, 3.0, 10 * HERTZ, False, None, ())


def hold(drawn: Drawn, periods: int) -> None:
    """Neither column is ever pulled, and the sample gives back no more than it has been given."""
    chain, path = drawn.path()
    times = np.arange(periods * FINE) * (SECOND * HERTZ // drawn.frequency // FINE)
    found = path.outputs(times, slice(0, None))
    force, x = found[chain.force], found[chain.displacement]
    scale = np.abs(force).max() + 1e-3
    for pressing in (found[0], found[1], force):
        assert pressing.min() >= -1e-12 * scale
    begun = force[0] * max(x[0] + drawn.advance, 0.0) / 2  # what it holds as it is met, still fresh
    given_back = -np.cumsum((force[1:] + force[:-1]) / 2 * np.diff(x))
    assert given_back.max() <= begun + 1e-3 * scale * np.ptp(x)


@pytest.mark.parametrize(
    ("drawn", "periods"),
    [
        (LOST, 2), (dataclasses.replace(LOST, moving=True, stop=1e-3), 2), (scene_of(1), 2),
        *(pytest.param(scene_of(seed), 6, marks=pytest.mark.slow) for seed in range(2, 14)),
    ],
)  # fmt: skip
def test_a_sample_that_creeps_is_never_pulled_and_gives_back_no_more_than_it_was_given(
    drawn: Drawn, periods: int
) -> None:
    hold(drawn, periods)


def forces(drawn: Drawn, until: float) -> tuple[Floats, Floats]:
    """Times, and the forces on tooth and ring then, by an integrator that knows of no modes: each column's surface is
    at the probe, or above it where it is free of force."""
    stack = drawn.stack()
    stiffness = stack.d.diagonal()

    def columns(t: float, z: Floats) -> tuple[Floats, Floats]:
        push = FORCE_CONSTANT / RESISTANCE * drawn.volts * np.sin(20 * np.pi * t)
        surfaces = -(stack.c @ z) / stiffness
        # Balance: a sum that grows with x, of straight pieces; so it is between two surfaces, or beyond both.
        for touching in (np.array([a, b]) for a in (True, False) for b in (True, False)):
            x = (push - (stiffness * touching) @ (drawn.advance - surfaces)) / (
                SUSPENSION + (stiffness * touching).sum()
            )
            if ((x + drawn.advance >= surfaces) == touching).all():
                break
        return np.maximum(x + drawn.advance, surfaces), surfaces

    grid = np.arange(0, round(1e3 * until)) * 1e-3
    done = scipy.integrate.solve_ivp(
        lambda t, z: stack.a @ z + stack.b @ columns(t, z)[0],
        (0, until), np.zeros(stack.order), method="DOP853", t_eval=grid, rtol=1e-10, atol=1e-14, max_step=1e-3,
    )  # fmt: skip
    pressed_to = [columns(t, z) for t, z in zip(grid, done.y.T, strict=True)]
    return grid, np.array([stiffness * (to - free) for to, free in pressed_to]).T


@pytest.mark.slow
def test_the_probe_meets_the_surface_where_it_has_relaxed_to() -> None:
    """An integrator says where; surfaces at rest, or contact that ends with the compression, would be 5 % off."""
    chain, path = LOST.path()
    grid, expected = forces(LOST, 0.15)
    found = path.outputs(np.round(1e9 * grid).astype(np.int64), slice(0, OUTPUTS))
    assert np.abs(found - expected).max() < 1e-7 * expected.max()
    touches = [mode.touch.contact for mode in path.modes_until(150 * MS)]
    assert {(True, True), (False, False)} < set(touches)  # and one column before the other
    compression = path.outputs(np.round(1e9 * grid).astype(np.int64), slice(chain.compression, chain.compression + 1))
    assert (found.sum(axis=0)[compression[0] > 0] == 0).any()


def test_a_sample_is_mounted_fresh_whatever_the_last_one_has_crept() -> None:
    chosen = dataclasses.replace(scene(), effects={"viscoelastic": an_effect("viscoelastic", material="soft_tissue")})
    clock = VirtualClock()
    rig = Rig(chosen, clock)
    pressed(rig, "2", BALANCE + 4e-3, 0.0)
    first = rig.cell_force(np.array([clock.now_ns()]))[0]
    clock.wait(100.0)
    crept = rig.cell_force(np.array([clock.now_ns()]))[0]
    rig.set_position(0.0)
    pressed(rig, "2", BALANCE + 4e-3, 0.0)
    assert crept < 0.8 * first
    assert rig.cell_force(np.array([clock.now_ns()]))[0] == pytest.approx(first, rel=1e-12)
