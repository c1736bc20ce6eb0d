"""The key `p` at a terminal: pause, and go on."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from palpate.procedures.console.terminal import say
from palpate.procedures.steps.pause import NOBODY, Pause

KEY = b"p"


class Keyboard:
    """Meets `palpate.procedures.steps.pause.Pause`; the terminal passes each key on at once.

    A terminal may be closed under a program that ignores it (nohup): then nobody presses a key any more.
    """

    def __init__(self, terminal: int) -> None:
        self._terminal = terminal

    def asked(self) -> bool:
        """Whether `p` is among the keys that were pressed since."""
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
    """The keyboard where someone sits at it; else nobody."""
    if sys.stdin is None or not sys.stdin.isatty():  # None: a service manager has closed it
        yield NOBODY
        return
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal)
        yield Keyboard(terminal)
    finally:
        with suppress(termios.error):  # it has been closed
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)
