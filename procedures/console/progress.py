"""Progress of a long job: a bar on the terminal; without one, a line now and then."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING

from palpate.instrument.notice import duration
from palpate.procedures.console.terminal import Spoken, console, say

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as Bar
    from rich.progress import Task
    from rich.text import Text

Progress = Callable[[int, int, str], None]
"""Called with the number of finished points, of all points, and what is done now."""

LEAST, SHARE = 30.0, 0.1  # least time between two lines [s], also as a share of the time so far

_bars: list[Bar] = []  # that are on the terminal now


def silent(_done: int, _total: int, _what: str) -> None:
    """A `Progress` that does nothing."""


class Shown:
    """A `Progress` for people, which knows how much time is left.

    A run on a bench whose time is that of the wall has a plan, of which it tells how much time is left. That is then
    corrected by how long the steps so far took. Any other job is taken to go on as fast as it was.
    """

    def __init__(self, show: Callable[[int, int, str], object]) -> None:
        """Make one; `show` is called after each report with the same arguments."""
        self._show = show
        self._done, self._total, self._begins = 0, 0, 0
        self._begun = self._since = monotonic()
        self._planned: float | None = None  # time that is left by the plan [s]
        self._whole = 0.0  # of the plan [s]
        self._took = self._expected = 0.0  # of the steps that were taken: their time, and by the plan [s]

    def promised(self, seconds: float) -> None:
        """Tell how much time is left by the plan [s]: before the first step, and after each."""
        now = monotonic()
        if self._planned is None:
            self._whole = seconds
        elif self._done == self._begins + 1:  # else steps were skipped
            self._took += now - self._since
            self._expected += max(self._planned - seconds, 0.0)
        self._planned, self._begins, self._since = seconds, self._done, now

    def __call__(self, done: int, total: int, what: str) -> None:
        self._done, self._total = done, total
        self._show(done, total, what)

    def left(self) -> float | None:
        """Time that is left [s]; None: it is not known."""
        now = monotonic()
        if self._planned is None:
            done, total = self._done, self._total
            return (now - self._begun) * (total - done) / done if 0 < done <= total else None
        if self._done >= self._total or not self._whole:
            return 0.0
        # One step is as little as nothing to judge by: so the plan counts as much as one step.
        usual = self._whole / self._total
        pace = (self._took + usual) / (self._expected + usual)
        return max(0.0, pace * self._planned - (now - self._since))


@contextmanager
def shown(first: str, lines: bool = True) -> Iterator[Progress]:
    """A progress bar on stderr if it is a terminal, else a line now and then.

    Args:
        first: text of the bar at the beginning.
        lines: False: no lines.
    """
    screen = console(file=Spoken())
    if screen.is_terminal:
        with _bar(screen, first) as progress:
            yield progress
    else:
        yield _in_lines() if lines else silent


def _in_lines() -> Progress:
    begun = last = monotonic()

    def show(done: int, total: int, what: str) -> None:
        nonlocal last
        now = monotonic()
        if now - last < max(LEAST, SHARE * (now - begun)):
            return
        last, left = now, progress.left()
        of = f"{done} of {total}" if total else f"{done} done"
        until = f", about {duration(left)} left" if left else ""
        say(f"palpate: progress: {of}{until}; {what}", err=True)

    progress = Shown(show)
    return progress


@contextmanager
def _bar(screen: Console, first: str) -> Iterator[Progress]:
    from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, TextColumn
    from rich.progress import Progress as Bar
    from rich.text import Text

    class Left(ProgressColumn):
        def render(self, task: Task) -> Text:
            left = progress.left()
            return Text("" if left is None else duration(left), style="progress.remaining")

    def show(done: int, total: int, what: str) -> None:
        begins = drawn.tasks[0].total is None  # how much there is to do is shown at once, however short it is
        drawn.update(task, completed=done, total=total, description=what, refresh=begins)

    progress = Shown(show)
    columns = (BarColumn(), MofNCompleteColumn(), Left(), TextColumn("{task.description}"))
    with Bar(*columns, console=screen) as drawn:
        task = drawn.add_task(first, total=None)
        _bars.append(drawn)
        try:
            yield progress
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
