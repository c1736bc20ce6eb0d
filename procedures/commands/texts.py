"""What the texts of options mean: `callback=quantity("N")` gives the command a number in place of a text.

What reads a text is imported when there is one to read, so that commands start soon.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

import click

from palpate.instrument.errors import PalpateError, UsageError

if TYPE_CHECKING:
    from palpate.procedures.measurements.references.reference import Reference

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


def bench_time(example: str) -> Callback[float]:
    """A time [s] that messages quote as it was typed, such as "2 min"."""

    def read(text: str) -> float:
        from palpate.instrument.quantity import Typed, parse

        return Typed(parse(text, "s", example), text.strip())

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


@_callback
def loads(text: str) -> tuple[float, ...]:
    from palpate.procedures.steps.checks import parse_loads

    return parse_loads(text)


def references(_context: click.Context, option: click.Parameter, given: tuple[str, ...]) -> tuple[Reference, ...]:
    """Objects of known modulus, one for each time that the option is given."""
    from palpate.procedures.measurements.references.reference import read_reference

    read = _callback(read_reference)
    return tuple(found for text in given if (found := read(_context, option, text)) is not None)


@_callback
def positions(text: str) -> tuple[float, ...]:
    from palpate.procedures.steps.checks import parse_steps

    return parse_steps(text, "m", "positions", "0 mm:24 mm:2 mm")


@_callback
def frequencies(text: str) -> tuple[float, ...]:
    from palpate.procedures.measurements.frequency.procedure import parse_frequencies

    return parse_frequencies(text)
