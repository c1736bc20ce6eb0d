"""Pauses a run at a terminal: the key `p` pauses it, and `p` again goes on."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from palpate.instrument.own_process import Ends
from palpate.procedures.console.terminal import say
from palpate.procedures.steps.pause import NOBODY, Pause

KEY = b"p"


class Keyboard:
    """A `palpate.procedures.steps.pause.Pause` by keys; the terminal passes each key on at once.

    A terminal may close while the run goes on (nohup); from then on no key is pressed.
    """

    def __init__(self, terminal: int) -> None:
        self._terminal = terminal

    def asked(self) -> bool:
        """Whether `p` was pressed since the last call."""
        keys = b""
        while select.select([self._terminal], [], [], 0)[0]:
            read = self._read(1024)
            if not read:
                break
            keys += read
        return KEY in keys.lower()

    def wait(self) -> None:
        say("paused, outputs are off; press p to go on, Ctrl-C to stop", err=True)
        while (key := self._read(1)).lower() != KEY:
            if not key:
                return

    def _read(self, most: int) -> bytes:
        try:
            return os.read(self._terminal, most)
        except OSError:
            return b""


@contextmanager
def keyboard() -> Iterator[Pause]:
    """The keyboard if standard input is a terminal; else `NOBODY`, who never pauses."""
    if sys.stdin is None or not sys.stdin.isatty():  # None: a service manager has closed standard input
        yield NOBODY
        return
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    with Ends() as ends:
        ends.callback(_restore, terminal, before)
        tty.setcbreak(terminal)
        yield Keyboard(terminal)


def _restore(terminal: int, before: list[Any]) -> None:
    with suppress(termios.error):  # the terminal has been closed
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
