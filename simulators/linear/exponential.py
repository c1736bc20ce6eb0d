"""exp(A t) with every element right to the last digit of a float, whatever the poles.

The series of exp(A h) is summed for a step h so short that A h is small, and the result is squared again and again, in
decimal numbers of 60 digits. Squaring doubles the relative error, so 60 doublings, from a nanosecond to years, leave 40
digits. In ordinary floats squaring loses a digit with every three doublings, which shows for a slow pole beside a fast
one. SciPy's remedy for triangular matrices divides by the differences of the diagonal elements, so that nearly equal
poles lose all digits. Decimal arithmetic does not depend on the processor and gives the same bytes everywhere. Golub
and Van Loan, Matrix Computations, 4th ed. (2013), 9.3.
"""

from __future__ import annotations

import decimal
from decimal import Decimal

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats

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
