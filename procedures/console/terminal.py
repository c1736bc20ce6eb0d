"""All output to a terminal goes through this module, which makes control characters visible and harmless.

Names of files, scenes, samples and devices come from outside. A control character in one of them could otherwise
colour, move or overwrite other text in the terminal.
"""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, TextIO

import click

from palpate.instrument.notice import duration

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as Bar
    from rich.progress import Task
    from rich.text import Text


# Control characters except tab and line feed; characters that change the direction of writing or break lines.
_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
LAST_STREAM = 2  # number of stderr
_PICTURES, _DELETE, _OTHER = 0x2400, "\x7f", "\ufffd"


def clean(text: str) -> str:
    """The text with a visible symbol for each control character, as ␛ for escape."""
    return text if text.isprintable() else _CONTROLS.sub(_picture, text)


def _picture(found: re.Match[str]) -> str:
    character = found.group()
    if character == _DELETE:
        return "\u2421"
    return chr(_PICTURES + ord(character)) if ord(character) < ord(" ") else _OTHER


def say(text: str, *, err: bool = False) -> None:
    """Print a text, cleaned, on stdout or stderr."""
    click.echo(clean(text), err=err)


class Spoken:
    """stderr for messages that may be lost: if the terminal is gone, they are dropped without an error.

    The rest of the stream's buffer then goes to /dev/null; else Python would end with exit status 120.
    """

    def __getattr__(self, name: str) -> Any:
        return getattr(sys.stderr, name)

    def write(self, text: str) -> int:
        try:
            sys.stderr.write(text)
        except OSError:
            give_up(sys.stderr)
        return len(text)

    def flush(self) -> None:
        try:
            sys.stderr.flush()
        except OSError:
            give_up(sys.stderr)


def fill_streams() -> None:
    """Put /dev/null in the place of standard streams that the program was started without, as by `>&-`.

    Else the next file that is opened, a record or a serial line, gets the number of stdout or stderr, and libraries
    write to it.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= LAST_STREAM:
        os.set_inheritable(number, True)
    os.close(number)
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, _nowhere())


@cache
def _nowhere() -> TextIO:
    """/dev/null, open to the program's end."""
    return Path(os.devnull).open("r+", encoding="utf-8")


def give_up(stream: TextIO) -> None:
    """Send the buffer of a stream, and all further output, to /dev/null, because its reader is gone."""
    with suppress(OSError, ValueError):  # the stream is no file, or is closed
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def console(**settings: Any) -> Console:
    """rich's console for cleaned texts, without markup: square brackets are part of a name."""
    return _console_class()(highlight=False, markup=False, emoji=False, **settings)


@cache
def _console_class() -> type[Console]:
    from rich.console import Console
    from rich.segment import Segment

    class Cleaning(Console):
        def render(self, renderable: Any, options: Any = None) -> Any:
            """Clean all segments but rich's own control segments."""
            for segment in super().render(renderable, options):
                cleaned = segment.text if segment.control else clean(segment.text)
                yield segment if cleaned == segment.text else Segment(cleaned, segment.style)

        def on_broken_pipe(self) -> None:
            """Raise it, as all other output does; rich itself would end the program with exit status 1."""
            raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    return Cleaning


# --- Figures are written to files, for which it does not matter how the environment wants them shown ---
#
# A notebook hands its backend on, as MPLBACKEND, to every program that it starts; where that backend is not installed,
# matplotlib does not load.

BACKEND = "MPLBACKEND"


def draw_as_shipped() -> None:
    """Let the command line draw as matplotlib is shipped, whatever is set for windows and notebooks."""
    os.environ.pop(BACKEND, None)
    os.environ["MATPLOTLIBRC"] = os.devnull


def load_matplotlib() -> None:
    """Load matplotlib in a script, with the backend that the environment asks for if it is installed."""
    if "matplotlib" in sys.modules:
        return
    backend = os.environ.pop(BACKEND, None)
    import matplotlib

    if backend is not None:
        os.environ[BACKEND] = backend
        with suppress(ValueError):
            matplotlib.rcParams["backend"] = backend


# --- Progress of a long job: a bar on the terminal; without one, a line now and then -------------------

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
