"""The one way to a terminal: whatever a name holds, it shows and does nothing.

Names of files, scenes, samples and devices come from outside; a control character among them could colour, move or
rename what stands there already.
"""

from __future__ import annotations

import os
import re
import sys
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any, TextIO

import click

if TYPE_CHECKING:
    from rich.console import Console

# Controls but tab and line feed; what turns the direction of writing, or breaks a line otherwise.
_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
_PICTURES, _DELETE, _OTHER = 0x2400, "\x7f", "\ufffd"


def clean(text: str) -> str:
    """Each control character as a picture of itself, as ␛ for escape."""
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
    """stderr for what nobody needs to have seen: where the terminal has gone, it is not shown and nothing fails.

    What is left in the stream's buffer then goes to /dev/null; Python would end with exit status 120 for it.
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


def give_up(stream: TextIO) -> None:
    """Send to /dev/null what a stream still holds, and all that follows: nobody is at its end any more."""
    with suppress(OSError, ValueError):  # it is no file, or closed
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def console(**settings: Any) -> Console:
    """rich's console, which shows texts as they are, cleaned: what looks like markup is part of a name."""
    return _console_class()(highlight=False, markup=False, emoji=False, **settings)


@cache
def _console_class() -> type[Console]:
    from rich.console import Console
    from rich.segment import Segment

    class Cleaning(Console):
        def render(self, renderable: Any, options: Any = None) -> Any:
            """rich's own controls are segments of their own kind."""
            for segment in super().render(renderable, options):
                cleaned = segment.text if segment.control else clean(segment.text)
                yield segment if cleaned == segment.text else Segment(cleaned, segment.style)

    return Cleaning
