"""What the texts of options mean, and how a shell completes them: `callback=quantity("N")` gives a command a number.

What reads a text or lists what completes it is imported when it is asked, so that commands start soon.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from palpate.instrument.errors import PalpateError, UsageError

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem


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


Complete = Callable[[click.Context, click.Parameter, str], "list[CompletionItem]"]

MODELS = (
    "column", "column_fitted", "beam", "beam_exact", "beam_printed", "experiment", "surface", "axisymmetric", "solid",
)  # fmt: skip  # their table would import numpy


def _completed(names: Callable[[], Iterable[str]], *, file: bool) -> Complete:
    """Completes one of some names, or the name of a file or folder."""

    def complete(_ctx: click.Context, _param: click.Parameter, begun: str) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        fitting = [CompletionItem(name) for name in names() if name.startswith(begun)]
        return fitting or ([CompletionItem(begun, type="file")] if file else [])

    return complete


def _scenes() -> list[str]:
    from palpate.procedures.virtual.scene_list import names

    return names()


def _runs() -> list[str]:
    from palpate.procedures.lab.store import store
    from palpate.procedures.records.chain import is_run

    folders = Path(store())
    return sorted(path.name for path in folders.iterdir() if is_run(path)) if folders.is_dir() else []


complete_scene = _completed(_scenes, file=True)
complete_model = _completed(lambda: (*MODELS, "auto"), file=False)
complete_run = _completed(_runs, file=True)

SCENE = click.argument("scene", shell_complete=complete_scene)
RUN = click.argument("run", shell_complete=complete_run)
