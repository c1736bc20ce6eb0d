"""Pause and stop of a run by its live page."""

from __future__ import annotations

import secrets
import signal
import threading
from hmac import compare_digest

from palpate.drivers.clock import WallClock
from palpate.procedures.console.terminal import say
from palpate.procedures.steps.pause import NOBODY, Pause

LOOK = 0.05  # s between two looks whether a pause shall end


class PageControl:
    """What pages may do with the run of this process, if they know its token.

    It is a `Pause` that a page or the keyboard asks for; each of them ends it, too.
    """

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(16)
        self.keyboard: Pause = NOBODY
        self._toggled = threading.Event()

    def allows(self, token: str) -> bool:
        """Whether this is the token; the time that the answer takes does not tell how much of it is right."""
        return compare_digest(token.encode(), self.token.encode())

    def toggle(self) -> None:
        """Ask for a pause, or for the end of one."""
        self._toggled.set()

    def stop(self) -> None:
        """Stop the run as Ctrl-C does, or as SIGTERM where a shell lets a program in the background ignore that."""
        ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM if ignored else signal.SIGINT)

    def asked(self) -> bool:
        asked = self.keyboard.asked() or self._toggled.is_set()
        self._toggled.clear()
        return asked

    def wait(self) -> None:
        key = "" if self.keyboard is NOBODY else "press p, or "
        say(f"paused, outputs are off; {key}go on by the live page; Ctrl-C stops", err=True)
        while not self.asked():
            WallClock().wait(LOOK)
