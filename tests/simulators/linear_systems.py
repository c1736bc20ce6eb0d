"""Drives and linear systems that tests of closed forms have in common."""

from __future__ import annotations

import numpy as np

from palpate.instrument.arrays import Floats, Times
from palpate.simulators.linear.lti import StateSpace
from palpate.simulators.linear.periodic import HERTZ, Periodic

SECOND = 1_000_000_000
DAY = 86_400 * SECOND


def sine(amplitude: float = 1.0, frequency: int = 10 * HERTZ, mean: float = 0.0, start_ns: int = 0) -> Periodic:
    return Periodic(mean, frequency, start_ns, 0, np.array([1]), np.array([-1j * amplitude]))


def rich(harmonics: int, frequency: int = 9_999_000_001, start_ns: int = 1_234_567) -> Periodic:
    """A drive with many harmonics of no particular phase."""
    k = np.arange(1, harmonics + 1)
    return Periodic(0.3, frequency, start_ns, 123_456_789_012_345_678, k, np.exp(1j * k**2) / k)


def output(system: StateSpace, drive: Periodic, x0: Floats, times: Times) -> Floats:
    """Outputs (n,) of a system with one input and one output from state `x0` at the drive's start."""
    return system.drive((drive,)).trace((system.c, system.d), drive.start_ns, x0).at(times)[0]


def random_system(seed: int, order: int, inputs: int = 1, outputs: int = 1) -> StateSpace:
    """A stable one of no structure."""
    draw = np.random.default_rng(seed)
    a = draw.normal(size=(order, order)) * 30
    a -= (np.linalg.eigvals(a).real.max() + 5) * np.eye(order)
    shapes = ((order, inputs), (outputs, order), (outputs, inputs))
    b, c, d = (draw.normal(size=shape) for shape in shapes)
    return StateSpace(a, b, c, d)
