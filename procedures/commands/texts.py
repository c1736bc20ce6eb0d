"""What the texts of options mean: `callback=quantity("N")` gives the command a number in place of a text.

What reads a text is imported when there is one to read, so that commands start soon.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

import click

from palpate.instrument.errors import PalpateError, UsageError

T = TypeVar("T")
Callback = Callable[[click.Context, click.Parameter, str | None], T | None]


def _callback(read: Callable[[str], T]) -> Callback[T]:
    """A callback that raises UsageError, which names the option: the text cannot be read."""

    def called(_context: click.Context, option: click.Parameter, text: str | None) -> T | None:
        try:
            return None if text is None else read(text)
        except PalpateError as error:
            name = max(option.opts, key=len)
            raise error if name in str(error) else UsageError(f"{name}: {error}") from None

    return called


def quantity(unit: str, example: str = "", *, positive: bool = False) -> Callback[float]:
    """A number with its unit, such as "2 N": the command gets it in `unit`.

    Args:
        unit: the unit.
        example: a text for messages.
        positive: whether only values above 0 are allowed.
    """

    def read(text: str) -> float:
        from palpate.instrument.quantity import parse

        value = parse(text, unit, example)
        if positive:
            _check_positive([text], [value])
        return value

    return _callback(read)


def quantities(unit: str, example: str = "", *, positive: bool = False) -> Callback[tuple[float, ...]]:
    """A list of quantities, such as "5 Hz, 10 Hz": the command gets a tuple of numbers in `unit`.

    Args:
        unit, example, positive: as in `quantity`, for each of them.
    """

    def read(text: str) -> tuple[float, ...]:
        from palpate.instrument.quantity import parse_list

        values = parse_list(text, unit, example)
        if positive:
            _check_positive(text.split(","), values)
        return values

    return _callback(read)


def _check_positive(texts: Sequence[str], values: Sequence[float]) -> None:
    """Raises UsageError, which quotes the text: a value is not above 0 and finite."""
    for text, value in zip(texts, values, strict=True):
        if not 0 < value < math.inf:
            raise UsageError(f"{text.strip()!r} is not above 0 and finite; give a positive one")


@_callback
def share(text: str) -> float:
    from palpate.instrument.quantity import parse_tolerance

    return parse_tolerance(text)


@_callback
def place(text: str) -> tuple[float, float]:
    """Two lengths [m]."""
    from palpate.instrument.quantity import parse_list

    if text.count(",") != 1:
        raise UsageError(f"{text!r} is not two lengths; write for example '6 mm, 6 mm'")
    x, y = parse_list(text, "m")
    return x, y


@_callback
def samples(text: str) -> tuple[str, ...]:
    from palpate.instrument.sensor.sample import parse_samples

    return parse_samples(text)
