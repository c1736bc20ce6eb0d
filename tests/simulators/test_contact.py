"""A sample is pressed, never pulled: also where it creeps, and is left before its compression passes zero."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from random import Random

import numpy as np
import pytest
import scipy

from palpate.instrument.arrays import Floats
from palpate.simulators.clock import VirtualClock
from palpate.simulators.linear.lti import StateSpace, gain
from palpate.simulators.linear.path import Path
from palpate.simulators.linear.periodic import HERTZ, SECOND, Periodic, constant
from palpate.simulators.physics.chain import Armature, Limits, MeasuringChain, Plays, SpringStack, Touch
from palpate.simulators.planning.plan import followed
from palpate.simulators.rig import Rig
from tests.simulators.rigs import BALANCE, MS, an_effect, pressed, scene

FORCE_CONSTANT, RESISTANCE, SUSPENSION = 4.0, 3.5, 1000.0
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
        chain = MeasuringChain(
            Armature(FORCE_CONSTANT, RESISTANCE, SUSPENSION, *inertia), Limits(stop=self.stop), self.stack(),
            self.advance, Plays(False, self.radii, (0.1,) * len(self.radii)), gain(np.eye(4)[:OUTPUTS]),
            [gain(np.eye(1))] * OUTPUTS, np.zeros(OUTPUTS), 0.1, 0.0,
        )  # fmt: skip
        drive = Periodic(0.0, self.frequency, 0, 0, np.array([1]), np.array([-1j * self.volts]))
        mode = chain.mode(Touch(contact=(False, False), drag=(0,) * chain.plays))
        return chain, Path((drive, constant(1.0, drive), drive.derivative()), mode, 0, np.zeros(mode.system.order))


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


@pytest.mark.parametrize("drawn", [LOST, dataclasses.replace(LOST, moving=True, stop=1e-3), scene_of(1)])
def test_a_sample_that_creeps_is_never_pulled_and_gives_back_no_more_than_it_was_given(drawn: Drawn) -> None:
    hold(drawn, periods=2)


@pytest.mark.slow
def test_in_many_scenes_a_sample_that_creeps_is_never_pulled() -> None:
    for seed in range(2, 14):
        hold(scene_of(seed), periods=6)


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


def test_what_recurs_is_what_is_followed_and_what_is_called_settled() -> None:
    """A scene that loses contact with a sample that creeps."""
    chosen = dataclasses.replace(scene(), effects={"viscoelastic": an_effect("viscoelastic")})
    rig = Rig(chosen, VirtualClock())
    pressed(rig, "2", BALANCE + 2e-3, 5.0)
    times = 20 * SECOND + np.arange(1000) * MS
    force = rig.cell_force(times)
    assert force.min() == 0.0
    path = rig.path
    assert path.cycle is not None
    late = path.cycle.start_ns // (100 * MS) * 100 * MS
    again = rig.cell_force(late + np.arange(100, 200) * MS)
    assert np.abs(again - force[:100]).max() < 1e-10 * force.max()
    turns = np.exp(-2j * np.pi * 10 * 1e-3 * np.arange(1000))
    assert abs(followed(rig)[-1]) == pytest.approx(abs(2 * (force * turns).mean()), rel=1e-3)


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
