"""Comparison of integrators on one stiff chain: error against time, with failures.

The chain has 9 states in series under a 10 Hz sine, from rest: coil (1 us), armature, sample with two Prony terms,
charge amplifier (1 s), anti-alias filters, bridge filter (0.1 s). The rates of its modes span six decades.
"""

from __future__ import annotations

import decimal
import functools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Complexes, Floats, Times
from palpate.simulators.linear.free_motion import DIGITS, decimals, exact, exponential
from palpate.simulators.linear.lti import StateSpace, first_order_high_pass, first_order_low_pass
from palpate.simulators.linear.periodic import HERTZ, SECOND, Periodic

DURATION = 10.0  # s, of the record
STATES = 9
STIFFNESS = 1e6  # fastest over slowest rate
SAMPLE_NS = 1_000_000  # ns between the samples that are compared
BLOCK = 100  # steps in one block of the matrix exponential
LOST = 1.0  # relative error from which an answer counts as worthless
DRIVE = Periodic(0.0, 10 * HERTZ, 0, 0, np.array([1]), np.array([-1j]))
STEPS_MS = (5.0, 1.0, 0.1)
EULER_US = (2.1, 1.9)
Adaptive = Literal["Radau", "LSODA"]
TOLERANCES: dict[Adaptive, tuple[float, ...]] = {"Radau": (1e-3, 1e-5), "LSODA": (1e-3, 1e-6, 1e-9)}
REPEATED = 0.05  # s; faster methods are measured again, and the least time counts


@dataclass(frozen=True, slots=True)
class IntegratorError:
    """One method at one setting.

    Attributes:
        setting: step [s] or relative tolerance; None: the method has no setting.
        error: greatest error of the output over its greatest value; None: the method failed.
        seconds: CPU time of the record [s].
        failure: reason of a failure, or "".
    """

    method: str
    setting: float | None
    error: float | None
    seconds: float
    failure: str


def chain() -> StateSpace:
    """The chain from the coil voltage to the last filter's output, in units in which all gains are about one."""
    resonance, damping = 2 * math.pi * 35, 0.15
    armature = StateSpace(
        np.array([[0.0, resonance], [-resonance, -2 * damping * resonance]]),
        np.array([[0.0], [resonance]]),
        np.array([[1.0, 0.0]]),
        np.zeros((1, 1)),
    )
    fast, tau = np.array([0.3, 0.2]), np.array([20e-3, 0.3])
    prony = StateSpace(-np.diag(1 / tau), (1 / tau)[:, np.newaxis], -fast[np.newaxis], np.array([[1 + fast.sum()]]))
    stages = (
        armature,
        prony,
        first_order_high_pass(1.0),
        first_order_low_pass(1e-3),
        first_order_low_pass(2e-3),
        first_order_low_pass(0.1),
    )
    return functools.reduce(StateSpace.then, stages, first_order_low_pass(1e-6))


def compare() -> Iterator[IntegratorError]:
    """Measure every method at every setting, from coarse to fine."""
    system = chain()
    times = np.arange(0, round(DURATION * SECOND) + 1, SAMPLE_NS)
    truth = _reference(system, times)

    def measured(
        method: str, setting: float | None, solve: Callable[[], Floats], at: Floats = truth
    ) -> IntegratorError:
        taken: list[float] = []
        while not taken or (sum(taken) < REPEATED and len(taken) < 5):
            start = time.process_time()
            try:
                with np.errstate(all="ignore"):
                    found = solve()
            except ArithmeticError as failed:
                return IntegratorError(method, setting, None, time.process_time() - start, str(failed))
            taken.append(time.process_time() - start)
        with np.errstate(all="ignore"):
            error = float(np.abs(found - at).max() / np.abs(truth).max())
        if not error < LOST:
            return IntegratorError(method, setting, None, min(taken), "diverges")
        return IntegratorError(method, setting, error, min(taken), "")

    for warm_up in (_closed_form(system, times[:1]), _stepped(system, _trapezoid, SECOND, 1)):
        assert warm_up.size  # the warm-up imports everything, so that no method's time contains an import
    yield measured("closed form", None, lambda: _closed_form(chain(), times))
    yield measured("matrix exponential, blocks", SAMPLE_NS / SECOND, lambda: _blocks(chain(), times, exponential))
    for method, formula in (("first-order hold", first_order_hold), ("trapezoid", _trapezoid)):
        for step_ms in STEPS_MS:
            step_ns = round(step_ms * 1e6)
            every, stride = max(step_ns // SAMPLE_NS, 1), max(SAMPLE_NS // step_ns, 1)
            solve = functools.partial(_stepped, system, formula, step_ns, stride)
            yield measured(method, step_ms * 1e-3, solve, truth[::every])
    for method in TOLERANCES:
        for tolerance in TOLERANCES[method]:
            yield measured(method, tolerance, functools.partial(_adaptive, system, method, tolerance, times))
    for step_us in EULER_US:
        step_ns = round(step_us * 1e3)
        stride = SAMPLE_NS // step_ns
        looks = np.arange(0, round(DURATION * SECOND) // step_ns + 1, stride) * step_ns
        solve = functools.partial(_stepped, system, _explicit_euler, step_ns, stride)
        yield measured("explicit Euler", step_us * 1e-6, solve, _closed_form(system, looks))


# --- exact ---------------------------------------------------------------------------------------------


def _closed_form(system: StateSpace, times: Times) -> Floats:
    output: Floats = system.drive((DRIVE,)).trace((system.c, system.d), 0, np.zeros(system.order)).at(times)[0]
    return output


def _blocks(
    system: StateSpace,
    times: Times,
    exponential: Callable[[Any], Any],
    numbers: Callable[[Floats], npt.NDArray[Any]] = np.asarray,
) -> Floats:
    """The chain with the oscillator that drives it, by powers of one matrix exponential, in numbers of any kind."""
    s, w = system.order, 2 * math.pi * DRIVE.frequency / HERTZ
    augmented = np.zeros((s + 2, s + 2))
    augmented[:s, :s], augmented[:s, s] = system.a, system.b[:, 0]
    augmented[s, s + 1], augmented[s + 1, s] = w, -w
    step = exponential(numbers(augmented * (SAMPLE_NS / SECOND)))
    rows = [numbers(np.concatenate([system.c[0], system.d[0], [0.0]]))]
    block = numbers(np.eye(s + 2))
    for _ in range(BLOCK):
        rows.append(rows[-1] @ step)
        block = block @ step
    state = numbers(np.eye(s + 2)[-1])
    states = []
    for _ in range(-(-len(times) // BLOCK)):
        states.append(state)
        state = block @ state
    return np.asarray((np.array(states) @ np.array(rows[:BLOCK]).T).ravel()[: len(times)], np.float64)


def _reference(system: StateSpace, times: Times) -> Floats:
    """The reference: blocks in decimal numbers of 60 digits."""
    with decimal.localcontext(DIGITS):
        return _blocks(system, times, exact, decimals)


# --- one step after the other --------------------------------------------------------------------------

Formula = Callable[[Complexes], tuple[Complexes, Complexes, Complexes]]


def first_order_hold(z: Complexes) -> tuple[Complexes, Complexes, Complexes]:
    """Coefficients of x <- a x + before u + after u', exact for a drive that is straight between steps.

    `z` is rate times step.

    """
    ramp: Complexes = np.where(np.abs(z) < 1e-3, 0.5 + z / 6 + z**2 / 24 + z**3 / 120, (np.expm1(z) - z) / z**2)
    return np.exp(z), np.expm1(z) / z - ramp, ramp


def _trapezoid(z: Complexes) -> tuple[Complexes, Complexes, Complexes]:
    half = 0.5 / (1 - z / 2)
    return (1 + z / 2) / (1 - z / 2), half, half


def _explicit_euler(z: Complexes) -> tuple[Complexes, Complexes, Complexes]:
    return 1 + z, np.ones_like(z), np.zeros_like(z)


def _stepped(system: StateSpace, formula: Formula, step_ns: int, stride: int) -> Floats:
    """The output at every `stride`th step, in the modes' coordinates, where a step is only nine multiplications."""
    from scipy.signal import lfilter

    assert system.motion.modes is not None
    rates, shapes, inverse = system.motion.modes
    u = DRIVE.at(np.arange(0, round(DURATION * SECOND) + 1, step_ns))
    step = step_ns / SECOND
    factors, before, after = formula(rates * step)
    pushed, seen = step * (inverse @ system.b[:, 0]), system.c[0] @ shapes
    output = system.d[0, 0] * u[::stride]
    for rate, push, own, new, weight in zip(factors, pushed, before, after, seen, strict=True):
        # In direct form, the filter's memory before the first step belongs to a state of zero.
        memory = np.array([-push * new * u[0]])
        x, _ = lfilter([push * new, push * own], [1.0, -rate], u.astype(complex), zi=memory)
        output = output + (weight * x[::stride]).real
    return np.asarray(output)


def _adaptive(system: StateSpace, method: Adaptive, tolerance: float, times: Times) -> Floats:
    import warnings

    from scipy.integrate import solve_ivp

    a, b, w = system.a, system.b[:, 0], 2 * math.pi * DRIVE.frequency / HERTZ
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        done = solve_ivp(
            lambda t, x: a @ x + b * math.sin(w * t), (0, DURATION), np.zeros(system.order), method=method,
            t_eval=times / SECOND, rtol=tolerance, atol=1e-3 * tolerance, jac=lambda t, x: a,
        )  # fmt: skip
    if not done.success:
        raise ArithmeticError(str(warned[0].message).split(" (")[0] if warned else done.message)
    return np.asarray(system.c[0] @ done.y + system.d[0, 0] * np.sin(w * times / SECOND))
