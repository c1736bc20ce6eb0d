"""Ownership of the exciter: only the program that owns its guard may drive, and feeds the guard's watchdog."""

from __future__ import annotations

from collections.abc import Callable

from palpate.drivers.clock import Clock
from palpate.drivers.devices.exciter import Exciter, WatchdogGuard
from palpate.instrument.errors import BenchInUse

CLAIMS = 10  # number of claims that are tried within the watchdog's time-out


def claim(guard: WatchdogGuard, clock: Clock, waits: Callable[[str], object]) -> None:
    """Become the guard's owner. The claim of a killed program ends after the watchdog's time-out, which is waited for.

    Args:
        guard: the guard.
        clock: the bench's clock.
        waits: called with the reason before such a wait.

    Raises:
        BenchInUse: another program owns the guard and is alive; nothing was changed.
    """
    if guard.claim():
        return
    watchdog = guard.get("watchdog")
    waits(
        f"{guard.name}: is busy, or belongs to another program or to one that was killed; waiting {watchdog:g} s, "
        "after which a killed one's claim ends"
    )
    piece = watchdog / CLAIMS
    for _ in range(CLAIMS):
        clock.wait(piece)
        if guard.claim():
            return
    raise BenchInUse(f"{guard.name}: belongs to another program, which feeds its watchdog; wait for it or end it")


def cautions(exciter: Exciter | None) -> list[str]:
    """Notes for a person before an exciter drives: why its output could stay on if this program dies."""
    if exciter is None or (exciter.guard is not None and exciter.guard.owned):
        return []
    if exciter.guard is None:
        name = exciter.members[0].name
        return [
            f"{name}: has no watchdog, so that nothing switches it off when this program is killed or a cable is cut; "
            "stay beside it"
        ]
    return [
        f"{exciter.guard.name}: any request feeds its watchdog, so that whoever else reads it keeps its output on "
        "when this program dies; see that nobody does",
    ]
