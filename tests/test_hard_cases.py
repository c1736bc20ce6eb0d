"""Cases that are hard to compute, each beside a reference that shares no solver with it: how many digits agree.

`python -m tests.benchmarks hard_cases` prints all of them, the hardest first; tests hold the digits of each. What goes
into a reference (equations, parameters, meshes) is input and the same on both sides; what comes out of it is predicted
on both sides; nothing is fitted to the other.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse import csc_array

from palpate.instrument.arrays import Floats
from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.models.solid.parts import SolidStack
from palpate.instrument.models.solid.system import System
from palpate.simulators.linear.lti import StateSpace
from palpate.simulators.linear.periodic import HERTZ, SECOND, Periodic, constant
from palpate.simulators.physics.chain import Armature, Limits, Plays, SpringStack
from palpate.simulators.planning.plan import Question, driven
from tests.instrument.direct import direct
from tests.settings import solid_sensors
from tests.simulators.rigs import NO_PLAYS, an_effect, chain_on, scene

TOOTH, RING, SHARE = 120.0, 380.0, 0.4  # N/m, N/m
RESISTANCE, SUSPENSION, MASS = 3.5, 1000.0, 0.03
DIGITS = 50
MET = 1e-13  # m
GRID = 1e-4  # s, in which a force has one extreme at most
Times = np.ndarray[Any, np.dtype[np.int64]]


@dataclass(frozen=True)
class HardCase:
    """A case, its reference, what of it is predicted, and the digits that it must have."""

    name: str
    reference: str
    predicted: str
    least: float
    error: Callable[[], float]


# --- A shaker on a sample: contact, stops, creep and plays, with inertia --------------------------------


@dataclass(frozen=True)
class Shaker:
    """A shaker with inertia on two columns, whose surfaces may creep. `drive` is its frequency [nHz]."""

    advance: float
    volts: float
    drive: int
    force_constant: float
    damping: float
    creep: tuple[tuple[float, float], ...] = ()  # shares and time constants [s]
    stop: float | None = None
    plays: Plays = NO_PLAYS
    inductance: float = 1e-4

    @functools.cached_property
    def stack(self) -> StateSpace:
        springs = SpringStack(TOOTH, RING, SHARE)
        if not self.creep:
            return springs.elastic()
        g, tau = zip(*self.creep, strict=True)
        creep = an_effect("viscoelastic", g=g, tau=[f"{each!r} s" for each in tau])
        return creep.stack(springs)

    def followed(self, times: Times) -> tuple[Floats, int]:
        """The tooth's force with its plays, and the whole force (2, n) [N], by palpate; and the transitions."""
        armature = Armature(self.force_constant, RESISTANCE, SUSPENSION, self.inductance, MASS, self.damping)
        _, path = chain_on(
            self.stack, self.advance, self.volts, self.drive,
            armature=armature, limits=Limits(stop=self.stop), plays=self.plays,
        )  # fmt: skip
        return path.outputs(times, slice(0, 2)), len(path.modes_until(int(times[-1]))) - 1

    def integrated(self, times: Floats) -> Floats:
        """The same by Runge-Kutta of order 8 from event to event, which knows of no modes; plays by their rule."""
        pieces = self._pieces(float(times[-1]))
        starts = [start for start, _, _ in pieces]

        def forces(t: float) -> Floats:
            _, motion, on = pieces[max(np.searchsorted(starts, t, side="right") - 1, 0)]
            return np.asarray(self._stiff * self._gaps(motion(t))[:2] * on[:2])

        def dragging(t: float) -> float:
            return float(forces(t)[0])

        wanted = set(times.tolist())
        grid = sorted({*wanted, *starts, *np.arange(0.0, times[-1], GRID).tolist()})
        points = [(t, dragging(t)) for t in grid]
        for (low, x), (_, middle), (high, y) in zip(points, points[1:], points[2:], strict=False):
            if self.plays.radii and (middle - x) * (y - middle) < 0:
                points.append(_extreme(dragging, low, high, math.copysign(1.0, middle - x)))
        played, found = [0.0] * len(self.plays.radii), []
        for t, x in sorted(points):
            played = [max(x - r, min(x + r, z)) for r, z in zip(self.plays.radii, played, strict=True)]
            if t in wanted:
                added = math.fsum(w * z for w, z in zip(self.plays.weights, played, strict=True))
                found.append([x + added, forces(t).sum()])
        return np.array(found).T

    @functools.cached_property
    def _stiff(self) -> Floats:
        return np.asarray(self.stack.d.diagonal())

    def _gaps(self, z: Floats) -> Floats:
        """How far each column is pressed beyond its surface, and the armature is beyond the stop."""
        surfaces = -(self.stack.c @ z[3:]) / self._stiff
        return np.append(z[1] + self.advance - surfaces, abs(z[1]) - (self.stop or math.inf))

    def _pieces(self, until: float) -> list[tuple[float, Callable[[float], Floats], list[bool]]]:
        """From event to event: when each begins, its motion, and which columns and stop are touched."""
        stack, rate = self.stack, 2 * math.pi * self.drive / HERTZ
        t, z, on = 0.0, np.zeros(3 + stack.order), [True, True, False]
        pieces: list[tuple[float, Callable[[float], Floats], list[bool]]] = []
        while t < until:

            def slope(t: float, z: Floats, on: list[bool] = on) -> Floats:
                gaps = self._gaps(z)
                pressed = self._stiff * gaps[:2] * on[:2]
                to = (pressed - stack.c @ z[3:]) / self._stiff  # a column that nothing presses ends at its surface
                push = self.force_constant * z[0] - self.damping * z[2] - SUSPENSION * z[1] - pressed.sum()
                push -= Limits().stop_stiffness * gaps[2] * math.copysign(1.0, z[1]) if on[2] else 0.0
                coil = self.volts * math.sin(rate * t) - RESISTANCE * z[0] - self.force_constant * z[2]
                return np.concatenate([[coil / self.inductance, z[2], push / MASS], stack.a @ z[3:] + stack.b @ to])

            events = []
            for k in range(3 if self.stop else 2):

                def event(_: float, z: Floats, k: int = k) -> float:
                    return float(self._gaps(z)[k])

                event.terminal, event.direction = True, -1.0 if on[k] else 1.0  # type: ignore[attr-defined]
                events.append(event)
            done = solve_ivp(
                slope, (t, until), z, "DOP853", rtol=2e-13, atol=1e-15, max_step=5e-4, events=events, dense_output=True
            )
            pieces.append((t, done.sol, on))
            t, z = float(done.t[-1]), done.y[:, -1]
            met = np.abs(self._gaps(z)) < MET if done.status else [False] * 3  # columns may be left at one time
            on = [was != now for was, now in zip(on, met, strict=True)]
        return pieces

    def error(self, times: Times, transitions: int) -> float:
        """Greatest difference of both forces, over the greatest of each; with so many transitions or more."""
        found, met = self.followed(times)
        assert met >= transitions, met
        known = self.integrated(1e-9 * times)
        return float((np.abs(found - known).max(axis=1) / np.abs(known).max(axis=1)).max())


def _extreme(force: Callable[[float], float], low: float, high: float, sign: float) -> tuple[float, float]:
    """Time and value of the extreme between two times, by golden section."""
    shorter = (math.sqrt(5) - 1) / 2
    for _ in range(50):
        a, b = high - shorter * (high - low), low + shorter * (high - low)
        low, high = (low, b) if sign * force(a) > sign * force(b) else (a, high)
    return (low + high) / 2, force((low + high) / 2)


PULSED = Shaker(1.5e-4, 5.0, round(HERTZ * math.sqrt(1500 / MASS) / (2 * math.pi)), 0.03, 2.9e-4, inductance=0.01)
CHATTER = Shaker(
    1e-3, 3.0, 10 * HERTZ, 4.0, 2.0, creep=((0.3, 0.1),), stop=1.2e-3,
    plays=Plays(ring=False, radii=(0.01, 0.05, 0.2), weights=(0.3, 0.2, 0.1)),
)  # fmt: skip


# --- Linear chains in 50 digits ------------------------------------------------------------------------


def _in_digits(system: StateSpace, volts: Periodic, state: Floats, elapsed_ns: Times, rows: slice) -> Floats:
    """Outputs (rows, n) under a sine that begins at phase 0, by mpmath; inputs are voltage, 1, and voltage's rate."""
    order = system.order
    with mpmath.workdps(DIGITS + 30):
        w = 2 * mpmath.pi * mpmath.mpf(volts.frequency) / HERTZ
        size = mpmath.mpf(float(abs(volts.amplitude[0])))
        # sin and cos of the drive, and 1, are states, too.
        whole = mpmath.zeros(order + 3)
        a, b = mpmath.matrix(system.a.tolist()), mpmath.matrix(system.b.tolist())
        c, d = mpmath.matrix(system.c[rows].tolist()), mpmath.matrix(system.d[rows].tolist())
        whole[:order, :order] = a
        for i in range(order):
            whole[i, order], whole[i, order + 1], whole[i, order + 2] = b[i, 0] * size, b[i, 2] * size * w, b[i, 1]
        whole[order, order + 1], whole[order + 1, order] = w, -w
        begun = mpmath.matrix([*state.tolist(), 0, 1, 1])
        found = []
        for elapsed in elapsed_ns.tolist():
            at = mpmath.expm(whole * (mpmath.mpf(elapsed) / SECOND), method="taylor") * begun
            seen = c * at[:order] + d * mpmath.matrix([size * at[order], 1, size * w * at[order + 1]])
            found.append([float(each) for each in seen])
    return np.array(found).T


def _at_frequency(frequency: float) -> float:
    """All films of a scene with inertia, creep and amplifiers, from the drive's first moment on, and settled."""
    chosen = scene("charge_amplifier")
    effects = {**chosen.effects, **{name: an_effect(name) for name in ("shaker_dynamics", "viscoelastic")}}
    rig = driven(replace(chosen, effects=effects), Question(frequency=frequency, load=1.0))
    path, volts = rig.path, rig.coil_voltage()
    period = 1e9 / frequency
    times = np.unique(np.round(period * np.array([0.013, 0.37, 1.2, 7.31, 123.456])).astype(np.int64))
    rows = slice(0, len(chosen.design.films))
    known = _in_digits(path.mode_at(0).system, volts, path.state(0), times, rows)
    found = rig.film_voltages(times)
    assert not rig.transitions(int(times[-1]))
    return float((np.abs(found - known).max(axis=1) / np.abs(known).max(axis=1)).max())


def _at_its_peak() -> float:
    """Q of 1e4, driven at its peak, from rest to where it has settled."""
    w, quality = 2 * math.pi * 35.0, 1e4
    a = np.array([[0.0, 1.0], [-(w**2), -w / quality]])
    push = np.array([[0.0, 0.0, 0.0], [w**2, 0.0, 0.0]])
    system = StateSpace(a, push, np.array([[1.0, 0.0]]), np.zeros((1, 3)))
    peak = round(35.0 * math.sqrt(1 - 1 / (2 * quality**2)) * HERTZ)
    volts = Periodic(0.0, peak, 0, 0, np.array([1]), np.array([-1j]))
    times = np.array([0.1, 1.0, 10.0, 100.007, 1000.003, 2000.011]) * 1e9
    elapsed = np.round(times).astype(np.int64)
    inputs = (volts, constant(1.0, volts), volts.derivative())
    found = system.drive(inputs).trace((system.c, system.d), 0, np.zeros(2)).at(elapsed)
    known = _in_digits(system, volts, np.zeros(2), elapsed, slice(0, 1))
    return float((np.abs(found - known) / np.abs(known).max()).max())


# --- Finite elements by dense LAPACK -------------------------------------------------------------------

SMALLEST = Resolution(layers=1, ratio=0.2, sectors=1, degree=2)
MOST_UNKNOWNS = 1400  # displacements, so that a dense solution takes less than a second
# Worst is an object of Poisson ratio 0.4999, 23 mm thick. The reference has 14 digits there (refined by residuals in 80
# bits), and palpate 12 at 0.495, where nothing is extrapolated: with half the LEAST_COMPLIANCE, 13 times less is lost.
DENSE_DIGITS = 6.0
KEEPS_VOLUME = "; fewest digits where an object keeps its volume: palpate extrapolates its pressure to the fourth order"
SENSORS = 10  # in each of two cases


def _dense(matrix: csc_array, loads: Floats) -> Floats:
    """Solutions of a symmetric system by LU of the whole dense matrix, scaled, and refined three times."""
    whole = matrix.toarray()
    scale = 1 / np.sqrt(np.abs(whole.diagonal()) + (whole.diagonal() == 0))
    whole *= np.outer(scale, scale)
    factors, right = lu_factor(whole), scale[:, np.newaxis] * loads
    found = lu_solve(factors, right)
    for _ in range(3):
        found += lu_solve(factors, right - whole @ found)
    return np.asarray(scale[:, np.newaxis] * found)


def _beside_dense(sensors: Iterator[SolidParameters]) -> float:
    """Greatest difference of the force ratio between fronts with poles, and dense solutions for one modulus."""
    apart: list[float] = []
    while len(apart) < SENSORS:
        sensor = next(sensors)
        system = System(sensor, SMALLEST)
        if SolidStack(sensor, SMALLEST, system.mirrored).unknowns > MOST_UNKNOWNS:
            continue
        poles = system.curve([system.load(sensor.load_at)]).poles
        ours = float(poles.force_ratios(np.array([sensor.sensed_modulus])).ravel()[0])
        apart.append(abs(ours - direct(sensor, SMALLEST, _dense).force_ratio))
    return max(apart)


# --- all of them ---------------------------------------------------------------------------------------

CASES = (
    HardCase(
        "finite elements of 10 random round sensors",
        "dense LAPACK",
        f"force ratio, from the same element matrices{KEEPS_VOLUME}",
        DENSE_DIGITS,
        lambda: _beside_dense(iter(solid_sensors(80, 0, 0, seed=11))),
    ),
    HardCase(
        "finite elements of 10 random square sensors",
        "dense LAPACK",
        f"force ratio, from the same element matrices{KEEPS_VOLUME}",
        DENSE_DIGITS,
        lambda: _beside_dense(iter(solid_sensors(0, 80, 0, seed=12))),
    ),
    HardCase(
        "hysteresis and relaxation in chatter at a stop",
        "Runge-Kutta of order 8 with events",
        "forces, from the equations of motion",
        10.0,
        lambda: CHATTER.error(np.arange(1, 50) * (SECOND // 1000), 10),
    ),
    HardCase(
        "loss of contact at the peak of a Q of 1e4",
        "Runge-Kutta of order 8 with events",
        "forces, from the equations of motion",
        10.0,
        lambda: PULSED.error(np.arange(1, 300) * (SECOND // 1000), 10),
    ),
    HardCase(
        "a Q of 1e4 at its peak, from rest to 2000 s",
        "exp(A t) in 50 digits",
        "displacement, from the equation of motion",
        10.0,
        _at_its_peak,
    ),
    HardCase(
        "films at 1e-3 Hz", "exp(A t) in 50 digits", "voltages, from the chain's matrices", 11.0,
        lambda: _at_frequency(1e-3),
    ),
    HardCase(
        "films at 1e5 Hz", "exp(A t) in 50 digits", "voltages, from the chain's matrices", 11.0,
        lambda: _at_frequency(1e5),
    ),
)  # fmt: skip


# --- tests -------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_digits_agree(case: HardCase) -> None:
    assert -math.log10(case.error()) >= case.least
