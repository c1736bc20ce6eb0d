"""Tells the price of an elimination before it begins."""

from __future__ import annotations

from palpate.instrument.notice import price

RATE = 3e9  # multiplications in a second, on one core of a server of 2020


def begin(operations: float, unknowns: int) -> None:
    """Say that an elimination begins, if it is a long one.

    Args:
        operations: number of its multiplications.
        unknowns: number of its unknowns.
    """
    what = f"setting up a mesh of {unknowns} unknowns"
    price(what, operations / RATE, "; its answers for all moduli are then kept")
