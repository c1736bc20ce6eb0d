"""Progress of a long job, and a bar on the terminal that shows it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from palpate.procedures.console.terminal import Spoken, console

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

Progress = Callable[[int, int, str], None]
"""Called with the number of finished points, of all points, and what is done now."""

_bars: list[Bar] = []  # that are on the terminal now


def silent(_done: int, _total: int, _what: str) -> None:
    """A `Progress` that does nothing."""


@contextmanager
def bar(first: str) -> Iterator[Progress]:
    """A progress bar on stderr, if stderr is a terminal. `first` is its text at the beginning."""
    shown = console(file=Spoken())
    if not shown.is_terminal:
        yield silent
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Bar(*columns, console=shown) as drawn:
        task = drawn.add_task(first, total=None)

        def report(done: int, total: int, what: str) -> None:
            begins = drawn.tasks[0].total is None  # how much there is to do is shown at once, however short it is
            drawn.update(task, completed=done, total=total, description=what, refresh=begins)

        _bars.append(drawn)
        try:
            yield report
        finally:
            _bars.remove(drawn)


@contextmanager
def without_bar() -> Iterator[None]:
    """A context without the progress bar, so that it does not overwrite typed text."""
    stopped = list(_bars)
    for each in stopped:
        each.stop()
    try:
        yield
    finally:
        for each in stopped:
            each.start()
