"""A pause between two points: outputs off, and on again when it ends."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from palpate.drivers.bench import Bench
from palpate.procedures.records.record import PAUSED, Recorder

if TYPE_CHECKING:
    from palpate.procedures.records.resumed import Resumed


class Pause(Protocol):
    """Somebody who may ask for a pause."""

    def asked(self) -> bool:
        """Whether one has been asked for since the last."""

    def wait(self) -> None:
        """Return when it shall end."""


class Nobody:
    """Asks for none."""

    def asked(self) -> bool:
        return False

    def wait(self) -> None:
        raise AssertionError("nobody has asked for a pause")


NOBODY: Pause = Nobody()


class PausedAgain:
    """A `Pause` for replayed runs: it pauses for no time where the run was paused, else where somebody asks."""

    def __init__(self, record: Resumed, bench: Bench, pause: Pause) -> None:
        self._record, self._bench, self._pause = record, bench, pause
        self._before = False

    def asked(self) -> bool:
        self._before = self._record.paused(self._bench.clock.now_ns())
        return self._before or self._pause.asked()

    def wait(self) -> None:
        if not self._before:
            self._pause.wait()


def pause_here(pause: Pause, bench: Bench, record: Recorder) -> None:
    """Where a pause is asked for: outputs off until it ends. The probe stays; the load has to be set anew after it."""
    if not pause.asked():
        return
    bench.rest()
    record.event(PAUSED, "outputs off", bench.clock.now_ns())
    pause.wait()
    record.event("resumed", "outputs on", bench.clock.now_ns())
    bench.drive()
