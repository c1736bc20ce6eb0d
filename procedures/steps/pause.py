"""A pause between two points: outputs off, and on again when it ends."""

from __future__ import annotations

from typing import Protocol

from palpate.drivers.bench import Bench
from palpate.procedures.records.record import Recorder


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


PAUSED = "paused"  # kind of the event
NOBODY: Pause = Nobody()


def pause_here(pause: Pause, bench: Bench, record: Recorder) -> None:
    """Where a pause is asked for: outputs off until it ends. The probe stays; the load has to be set anew after it."""
    if not pause.asked():
        return
    bench.rest()
    record.event(PAUSED, "outputs off", bench.clock.now_ns())
    pause.wait()
    record.event("resumed", "outputs on", bench.clock.now_ns())
    bench.drive()
