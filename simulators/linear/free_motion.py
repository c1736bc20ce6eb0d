"""How a linear system moves by itself: exp(A t), by its modes, or by doublings where these are too nearly parallel."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.simulators.linear.exponential import Doublings

Floats = npt.NDArray[np.float64]
Complexes = npt.NDArray[np.complex128]
Times = npt.NDArray[np.int64]
# (p, n) at times [ns]; from when it moves freely; and what is between any two of the times, 0: they differ in it.
Seen = Callable[[Times, int, int], Floats]

# Above this condition number the modes are too nearly parallel to carry the transient to thirteen digits.
PARALLEL = 100.0
BLOCK = 1024  # samples that are found together
GONE = 1e-150  # of its beginning, below which a mode is nothing: products of two such still are ordinary numbers
KEPT = 64  # systems


class FreeMotion:
    """x' = A x from any state; `a` is (s, s). What was worked out for a matrix serves all systems that have it."""

    def __init__(self, a: Floats) -> None:
        self._a = a
        self._doublings = Doublings(a, "1e-9")  # of a nanosecond
        self._steps: dict[int, Floats] = {}
        self._elements: dict[int, tuple[Floats, Times, Times]] = {}

    @functools.cached_property
    def modes(self) -> tuple[Complexes, Complexes, Complexes] | None:
        """Rates (s,), shapes (s, s) and their inverse; None where they are too nearly parallel to be told apart."""
        if not len(self._a):
            return np.zeros(0, complex), np.zeros((0, 0), complex), np.zeros((0, 0), complex)
        from scipy.linalg import matrix_balance

        # In units in which rows and columns are alike: metres beside amperes are not nearly parallel.
        balanced, (units, _) = matrix_balance(self._a, permute=False, separate=True)
        rates, shapes = np.linalg.eig(balanced)
        if np.linalg.cond(shapes) > PARALLEL:
            return None
        inverse = np.linalg.inv(shapes) / units
        return rates.astype(complex), (units[:, np.newaxis] * shapes).astype(complex), inverse.astype(complex)

    @functools.cached_property
    def _rates(self) -> Floats | Complexes:
        """Of the modes that are real or turn forward; the other of a pair is its conjugate. Real where none turns."""
        assert self.modes is not None
        rates: Complexes = self.modes[0][self.modes[0].imag >= 0]
        return rates if rates.imag.any() else rates.real

    def seen(self, rows: Floats, x: Floats) -> Seen:
        """rows @ exp(A t) x, rows (p, s), as a function of time."""
        if self.modes is None:
            return functools.partial(self._of_doublings, rows, x)
        rates, shapes, inverse = self.modes
        weights = ((rows @ shapes) * (inverse @ x))[:, rates.imag >= 0]
        weights *= np.where(self._rates.imag > 0, 2.0, 1.0)
        return functools.partial(self._of_modes, weights if np.iscomplexobj(self._rates) else weights.real)

    def free(self, x: Floats, elapsed_ns: Times) -> Floats:
        """exp(A t) x, shape (s, n)."""
        return self.seen(np.eye(len(x)), x)(elapsed_ns, 0, 0)

    def moment(self, x: Floats, elapsed_ns: float) -> Floats:
        """exp(A t) x at one time, (s,)."""
        if self.modes is None:
            return self._later(x, round(elapsed_ns))
        rates, shapes, inverse = self.modes
        return np.asarray((shapes @ (np.exp(rates * (1e-9 * elapsed_ns)) * (inverse @ x))).real)

    def decay(self, x: Floats, elapsed_ns: Times) -> Floats:
        """exp(A t) x, shape (s, n), by the exponentials of 1, 2, 4, ... ns: it needs no modes."""
        answer = np.repeat(x[:, np.newaxis], len(elapsed_ns), axis=1)
        for bit in range(int(elapsed_ns.max(initial=0)).bit_length()):
            used = (elapsed_ns >> bit) & 1 == 1
            if used.any():
                answer[:, used] = real_product(self._doublings[bit], answer[:, used])
        return answer

    def _later(self, x: Floats, elapsed_ns: int) -> Floats:
        """The same at one time, of one state (s,) or of several (s, n) side by side: faster."""
        for bit in range(elapsed_ns.bit_length()):
            if elapsed_ns >> bit & 1:
                x = np.einsum("ij,j...->i...", self._doublings[bit], x)
        return x

    def _of_doublings(self, rows: Floats, x: Floats, time_ns: Times, start_ns: int, step_ns: int) -> Floats:
        """As `_of_modes`, with every element of exp(A t) in the place of a mode."""
        if not step_ns:
            return real_product(rows, self.decay(x, time_ns - start_ns))
        within, to, of = self._elements_within(step_ns)

        def heads(elapsed_ns: Times) -> Floats:
            return rows[:, to] * self.decay(x, elapsed_ns).T[:, np.newaxis, of]

        return on_grid(heads, within, int(time_ns[0]) - start_ns, len(time_ns), step_ns)

    def _elements_within(self, step_ns: int) -> tuple[Floats, Times, Times]:
        """The elements of exp(A t) in a block that are not always 0, (elements, BLOCK), and their rows and columns."""
        if step_ns not in self._elements:
            found = one = np.eye(len(self._a))[np.newaxis]
            while len(found) < BLOCK:
                step = self._later(one[0], len(found) * step_ns)
                found = np.concatenate([found, np.einsum("ij,kjl->kil", step, found)])
            found[np.abs(found) < GONE] = 0.0
            to, of = np.nonzero(found.any(axis=0))
            self._elements[step_ns] = np.ascontiguousarray(found[:, to, of].T), to, of
        return self._elements[step_ns]

    def _of_modes(self, weights: Floats | Complexes, time_ns: Times, start_ns: int, step_ns: int) -> Floats:
        """Blocks of samples, counted from the first one after the start, as products of what a mode is at a block's
        beginning and what it does within a block: the same bytes whatever part of a block is asked for."""
        if not step_ns:
            return _decaying(weights, self._rates, time_ns - start_ns)

        def heads(elapsed_ns: Times) -> Floats:
            modes = weights * np.exp((1e-9 * elapsed_ns)[:, np.newaxis, np.newaxis] * self._rates)
            modes[np.abs(modes) < GONE] = 0.0
            return self._parts(modes, axis=2)

        return on_grid(heads, self._within(step_ns), int(time_ns[0]) - start_ns, len(time_ns), step_ns)

    def _within(self, step_ns: int) -> Floats:
        """What the modes do in a block, (parts, BLOCK)."""
        if step_ns not in self._steps:
            turns = np.exp(np.outer(self._rates, 1e-9 * step_ns * np.arange(BLOCK)))
            turns[np.abs(turns) < GONE] = 0.0
            self._steps[step_ns] = self._parts(turns.conj(), axis=0)
        return self._steps[step_ns]

    def _parts(self, modes: Floats | Complexes, axis: int) -> Floats:
        """Real parts of all modes and imaginary parts of those that turn, along the modes' axis."""
        if not np.iscomplexobj(modes):
            return modes.real
        return np.concatenate([modes.real, modes.imag.compress(self._rates.imag > 0, axis)], axis)


def on_grid(heads: Callable[[Times], Floats], within: Floats, first_ns: int, count: int, step_ns: int) -> Floats:
    """Samples (p, count), `step_ns` apart, of blocks counted from time 0: the same bytes whatever is asked for.

    Args:
        heads: from the beginnings of blocks [ns] to what is then, (blocks, p, parts).
        within: what each part does in a block, (parts, BLOCK).
    """
    number, rest_ns = divmod(first_ns, step_ns)
    blocks = np.arange(number // BLOCK, (number + count - 1) // BLOCK + 1)
    parts = np.ascontiguousarray(heads(rest_ns + step_ns * BLOCK * blocks))  # how it lies decides how a BLAS rounds
    start = number - int(blocks[0]) * BLOCK
    found = np.empty((parts.shape[1], len(blocks), BLOCK))
    if len(within) == 1:
        np.multiply(parts.transpose(1, 0, 2), within, out=found)  # without the calls of a product
    else:
        np.matmul(parts, within, out=found.transpose(1, 0, 2))  # a stack of products: each block rounds as if alone
    return found.reshape(len(found), -1)[:, start : start + count]


def free_motion(a: Floats) -> FreeMotion:
    """Of a matrix (s, s); the same object for an equal one."""
    return _known(a.tobytes(), len(a))


@functools.lru_cache(maxsize=KEPT)
def _known(a: bytes, size: int) -> FreeMotion:
    return FreeMotion(np.frombuffer(a).reshape(size, size))


def real_product(weights: npt.NDArray[np.inexact[Any]], rows: npt.NDArray[np.inexact[Any]]) -> Floats:
    """Real part of weights @ rows; weights (..., k), rows (k, n), result (..., n).

    Summed row by row: a BLAS product rounds a column otherwise when it stands in a block of another length,
    and the same samples must be the same bytes whatever blocks they are asked for in.
    """
    total = np.zeros((*weights.shape[:-1], rows.shape[1]))
    for k, row in enumerate(rows):
        weight = weights[..., k, np.newaxis]
        total += weight.real * row.real - weight.imag * row.imag
    return total


def _decaying(weights: Floats | Complexes, rates: Floats | Complexes, elapsed_ns: Times) -> Floats:
    """Real part of weights @ exp(rates t), weights (p, s), shape (p, n)."""
    total = np.zeros((len(weights), len(elapsed_ns)))
    elapsed = 1e-9 * elapsed_ns
    for weight, rate in zip(weights.T[..., np.newaxis], rates, strict=True):
        if not weight.any():
            continue
        left = np.exp(rate.real * elapsed)
        if rate.imag == 0:
            total += weight.real * left
        else:
            angle = rate.imag * elapsed
            total += left * (weight.real * np.cos(angle) - weight.imag * np.sin(angle))
    return total
