"""A pause between two points. The outputs are off until it ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from palpate.procedures.records.record import PAUSED, Recorder

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench


class Pause(Protocol):
    """Somebody or something that may ask for a pause."""

    def asked(self) -> bool:
        """Whether a pause has been asked for since the last one."""

    def wait(self) -> None:
        """Wait until the pause shall end."""


class Nobody:
    """Never asks for a pause."""

    def asked(self) -> bool:
        return False

    def wait(self) -> None:
        raise AssertionError("nobody has asked for a pause")


NOBODY: Pause = Nobody()


class PausedAgain:
    """A `Pause` for a run that is done again: it rests for no time where the run was paused, or where somebody asks.

    `paused` tells whether the run was paused at a bench time [ns].
    """

    def __init__(self, paused: Callable[[int], bool], bench: Bench, pause: Pause) -> None:
        self._paused, self._bench, self._pause = paused, bench, pause
        self._before = False

    def asked(self) -> bool:
        self._before = self._paused(self._bench.clock.now_ns())
        return self._before or self._pause.asked()

    def wait(self) -> None:
        if not self._before:
            self._pause.wait()


def pause_here(pause: Pause, bench: Bench, record: Recorder) -> None:
    """Pause if that is asked for. The outputs are off and the probe stays; afterwards the load must be set anew.

    Outputs that were on before are on afterwards.
    """
    if not pause.asked():
        return
    driving = bench.driving
    bench.rest()
    record.event(PAUSED, "outputs off", bench.clock.now_ns())
    pause.wait()
    record.event("resumed", f"outputs {'on' if driving else 'off'}", bench.clock.now_ns())
    if driving:
        bench.drive()
