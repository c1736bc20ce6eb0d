"""All output to a terminal goes through this module, which makes control characters visible and harmless.

Names of files, scenes, samples and devices come from outside. A control character in one of them could otherwise
colour, move or overwrite other text in the terminal.
"""

from __future__ import annotations

import errno
import os
import re
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

if TYPE_CHECKING:
    from rich.console import Console


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
