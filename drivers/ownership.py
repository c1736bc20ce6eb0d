"""Who may drive: the program that owns the exciter's guard, the device whose watchdog only its owner feeds."""

from __future__ import annotations

from collections.abc import Callable

from palpate.drivers.clock import Clock
from palpate.drivers.devices.exciter import Exciter, Guard
from palpate.instrument.errors import BenchInUse

CLAIMS = 10  # that are tried within the time of the watchdog


def claim(guard: Guard, clock: Clock, waits: Callable[[str], object]) -> None:
    """Become the guard's owner. The claim of a program that was killed ends after the time of the watchdog.

    Args:
        waits: is told why, where that has to be waited for.

    Raises:
        BenchInUse: another program owns it and is alive; nothing has been changed.
    """
    if guard.claim():
        return
    watchdog = guard.get("watchdog")
    waits(
        f"{guard.name}: belongs to another program, or to one that was killed; waiting {watchdog:g} s, "
        "after which a killed one's claim ends"
    )
    piece = watchdog / CLAIMS
    for _ in range(CLAIMS):
        clock.wait(piece)
        if guard.claim():
            return
    raise BenchInUse(f"{guard.name}: belongs to another program, which feeds its watchdog; wait for it or end it")


def cautions(exciter: Exciter | None) -> list[str]:
    """What a person should know of an exciter before it drives: whether it goes on when this program dies."""
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
