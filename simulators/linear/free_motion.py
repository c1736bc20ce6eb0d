"""Free motion of a linear system: exp(A t) by its modes, or by doublings where modes are too nearly parallel."""

from __future__ import annotations

import decimal
import functools
from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Complexes, Floats, Times

# --- exp(A t) to the last digit ------------------------------------------------------------------------

# The series of exp(A h) is summed for a step h so short that A h is small, and the result is squared again and again,
# in decimal numbers of 60 digits. Squaring doubles the relative error, so 60 doublings, from a nanosecond to years,
# leave 40 digits. In ordinary floats squaring loses a digit with every three doublings, which shows for a slow pole
# beside a fast one. SciPy's remedy for triangular matrices divides by the differences of the diagonal elements, so that
# nearly equal poles lose all digits. Decimal arithmetic does not depend on the processor and gives the same bytes
# everywhere. Golub and Van Loan, Matrix Computations, 4th ed. (2013), 9.3.


DIGITS = decimal.Context(prec=60, Emax=decimal.MAX_EMAX, Emin=decimal.MIN_EMIN)
SMALL = Decimal("0.0625")  # greatest row sum of |A h|
# Terms beyond one for each state, which an element may need before it is not zero: (1/16)^24 / 24! is 1e-53.
TERMS = 24


Decimals = npt.NDArray[np.object_]


def decimals(a: Floats) -> Decimals:
    """The same numbers as decimals, exactly; to be used under `decimal.localcontext(DIGITS)`."""
    return np.array([Decimal(element) for element in a.ravel().tolist()], object).reshape(a.shape)


def exact(a: Decimals) -> Decimals:
    """exp(a) (s, s) to 40 digits."""
    size = len(a)
    halvings, largest = 0, max(sum(abs(element) for element in row) for row in a)
    while largest > SMALL:
        halvings, largest = halvings + 1, largest / 2
    step = a / Decimal(2**halvings)
    term = total = decimals(np.eye(size))
    for k in range(1, size + TERMS):
        term = term @ step / Decimal(k)
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total


def exponential(a: Floats) -> Floats:
    """exp(a) (s, s), to the last digit of a float."""
    with decimal.localcontext(DIGITS):
        return exact(decimals(a)).astype(np.float64)


class Doublings:
    """exp(A unit), exp(2 A unit), exp(4 A unit), ...; each is computed when it is first asked for.

    Args:
        a: (s, s), 1/s.
        unit: s, as text, such as "1e-9".
    """

    def __init__(self, a: Floats, unit: str) -> None:
        self._a, self._unit = a, Decimal(unit)
        self._found: list[Floats] = []
        self._last: Decimals | None = None

    def __getitem__(self, number: int) -> Floats:
        """exp(2^number A unit), (s, s)."""
        with decimal.localcontext(DIGITS):
            while len(self._found) <= number:
                last = self._last
                self._last = exact(decimals(self._a) * self._unit) if last is None else last @ last
                self._found.append(self._last.astype(np.float64))
        return self._found[number]


# --- free motion ---------------------------------------------------------------------------------------


# Gives (p, n) from times [ns], the start of the free motion [ns], and the step between times [ns] (0: not even).
Seen = Callable[[Times, int, int], Floats]

# Above this condition number modes are too nearly parallel to give the transient to thirteen digits.
PARALLEL = 100.0
WORTH = 0.95  # share of the sizes of row and column to which they must fall for another unit
BLOCK = 1024  # number of samples that are computed together
GONE = 1e-150  # share of a mode's beginning below which it counts as 0; the product of two such is still a normal float
KEPT = 64  # systems


def balanced(a: Floats) -> tuple[Floats, Floats]:
    """A matrix (s, s) in units (s,) in which rows and columns have like sizes: metres beside amperes look parallel.

    Units are powers of 2, as LAPACK's dgebal finds them (James, Langou and Lowery 2014). To import scipy.linalg for it
    would take longer than most scenes.
    """
    matrix, units = a.copy(), np.ones(len(a))
    changed = True
    while changed:
        changed = False
        for i in range(len(a)):
            column, row = float(np.linalg.norm(matrix[:, i])), float(np.linalg.norm(matrix[i]))
            if not column or not row:
                continue
            unit, before = 1.0, column + row
            while column < row / 2:
                unit, column, row = 2 * unit, 2 * column, row / 2
            while column / 2 >= row:
                unit, column, row = unit / 2, column / 2, 2 * row
            if column + row < WORTH * before:
                matrix[i] /= unit
                matrix[:, i] *= unit
                units[i] *= unit
                changed = True
    return matrix, units


class FreeMotion:
    """x' = A x from any state; `a` is (s, s). Results for a matrix are shared by all systems that have it."""

    def __init__(self, a: Floats) -> None:
        self._a = a
        self._doublings = Doublings(a, "1e-9")  # from a nanosecond on
        self._steps: dict[int, Floats] = {}
        self._elements: dict[int, tuple[Floats, Times, Times]] = {}

    @functools.cached_property
    def modes(self) -> tuple[Complexes, Complexes, Complexes] | None:
        """Rates (s,), shapes (s, s) and their inverse; None where they are too nearly parallel to be told apart."""
        if not len(self._a):
            return np.zeros(0, complex), np.zeros((0, 0), complex), np.zeros((0, 0), complex)
        matrix, units = balanced(self._a)
        rates, shapes = np.linalg.eig(matrix)
        if np.linalg.cond(shapes) > PARALLEL:
            return None
        inverse = np.linalg.inv(shapes) / units
        return rates.astype(complex), (units[:, np.newaxis] * shapes).astype(complex), inverse.astype(complex)

    @functools.cached_property
    def _rates(self) -> Floats | Complexes:
        """Rates of the modes that are real or turn forward; an array of floats where none turns."""
        assert self.modes is not None
        rates: Complexes = self.modes[0][self.modes[0].imag >= 0]
        return rates if rates.imag.any() else rates.real

    def seen(self, rows: Floats, x: Floats) -> Seen:
        """rows @ exp(A t) x, with rows (p, s), as a function of time."""
        if self.modes is None:
            return functools.partial(self._of_doublings, rows, x)
        rates, shapes, inverse = self.modes
        weights = ((rows @ shapes) * (inverse @ x))[:, rates.imag >= 0]
        weights *= np.where(self._rates.imag > 0, 2.0, 1.0)
        return functools.partial(self._of_modes, weights if np.iscomplexobj(self._rates) else weights.real)

    def free(self, x: Floats, elapsed_ns: Times) -> Floats:
        """exp(A t) x (s, n)."""
        return self.seen(np.eye(len(x)), x)(elapsed_ns, 0, 0)

    def moment(self, x: Floats, elapsed_ns: float) -> Floats:
        """exp(A t) x (s,) at one time."""
        if self.modes is None:
            return self._later(x, round(elapsed_ns))
        rates, shapes, inverse = self.modes
        return np.asarray((shapes @ (np.exp(rates * (1e-9 * elapsed_ns)) * (inverse @ x))).real)

    def decay(self, x: Floats, elapsed_ns: Times) -> Floats:
        """exp(A t) x (s, n) by the exponentials of 1, 2, 4, ... ns, without modes."""
        answer = np.repeat(x[:, np.newaxis], len(elapsed_ns), axis=1)
        for bit in range(int(elapsed_ns.max(initial=0)).bit_length()):
            used = (elapsed_ns >> bit) & 1 == 1
            if used.any():
                answer[:, used] = real_product(self._doublings[bit], answer[:, used])
        return answer

    def _later(self, x: Floats, elapsed_ns: int) -> Floats:
        """exp(A t) x at one time, of one state (s,) or of several (s, n) side by side, which is faster."""
        for bit in range(elapsed_ns.bit_length()):
            if elapsed_ns >> bit & 1:
                x = np.einsum("ij,j...->i...", self._doublings[bit], x)
        return x

    def _of_doublings(self, rows: Floats, x: Floats, time_ns: Times, start_ns: int, step_ns: int) -> Floats:
        """The same as `_of_modes`, with the elements of exp(A t) in place of modes."""
        if not step_ns:
            return real_product(rows, self.decay(x, time_ns - start_ns))
        within, to, of = self._elements_within(step_ns)

        def heads(elapsed_ns: Times) -> Floats:
            return rows[:, to] * self.decay(x, elapsed_ns).T[:, np.newaxis, of]

        return on_grid(heads, within, int(time_ns[0]) - start_ns, len(time_ns), step_ns)

    def _elements_within(self, step_ns: int) -> tuple[Floats, Times, Times]:
        """Elements (elements, BLOCK) of exp(A t) in a block that are not always 0, with their rows and columns."""
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
        """Blocks of samples as products of the modes at a block's beginning and the modes' motion within a block.

        Blocks are counted from the first sample after the start, so that any part of a block has the same bytes.
        """
        if not step_ns:
            return _decaying(weights, self._rates, time_ns - start_ns)

        def heads(elapsed_ns: Times) -> Floats:
            modes = weights * np.exp((1e-9 * elapsed_ns)[:, np.newaxis, np.newaxis] * self._rates)
            modes[np.abs(modes) < GONE] = 0.0
            return self._parts(modes, axis=2)

        return on_grid(heads, self._within(step_ns), int(time_ns[0]) - start_ns, len(time_ns), step_ns)

    def _within(self, step_ns: int) -> Floats:
        """Motion (parts, BLOCK) of the modes within a block."""
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
    """Samples (p, count), `step_ns` apart, from blocks that are counted from time 0: any part has the same bytes.

    Args:
        heads: function of the beginnings of blocks [ns] that gives the parts (blocks, p, parts) there.
        within: (parts, BLOCK), motion of each part within a block.
    """
    number, rest_ns = divmod(first_ns, step_ns)
    blocks = np.arange(number // BLOCK, (number + count - 1) // BLOCK + 1)
    parts = np.ascontiguousarray(heads(rest_ns + step_ns * BLOCK * blocks))  # the memory layout decides how BLAS rounds
    start = number - int(blocks[0]) * BLOCK
    found = np.empty((parts.shape[1], len(blocks), BLOCK))
    if len(within) == 1:
        np.multiply(parts.transpose(1, 0, 2), within, out=found)  # a product would take more calls
    else:
        np.matmul(parts, within, out=found.transpose(1, 0, 2))  # as a stack, each block is rounded as if it were alone
    return found.reshape(len(found), -1)[:, start : start + count]


def free_motion(a: Floats) -> FreeMotion:
    """Free motion of a matrix (s, s); the same object for equal matrices."""
    return kept_motion(a.tobytes(), len(a))


@functools.lru_cache(maxsize=KEPT)
def kept_motion(a: bytes, size: int) -> FreeMotion:
    return FreeMotion(np.frombuffer(a).reshape(size, size))


def real_product(weights: npt.NDArray[np.inexact[Any]], rows: npt.NDArray[np.inexact[Any]]) -> Floats:
    """Real part of weights @ rows; weights (..., k), rows (k, n), result (..., n).

    It is summed row by row. A BLAS product would round a column differently in a block of another length, but samples
    must have the same bytes in whatever blocks they are asked for.
    """
    total = np.zeros((*weights.shape[:-1], rows.shape[1]))
    for k, row in enumerate(rows):
        weight = weights[..., k, np.newaxis]
        total += weight.real * row.real - weight.imag * row.imag
    return total


def _decaying(weights: Floats | Complexes, rates: Floats | Complexes, elapsed_ns: Times) -> Floats:
    """Real part (p, n) of weights @ exp(rates t), with weights (p, s)."""
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
