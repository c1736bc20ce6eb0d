"""How long a program may wait for a silent device while a watchdog stands by to switch the exciter off."""

from __future__ import annotations

from palpate.instrument.bench.links import CanBus, Link
from palpate.instrument.quantity import show

READ_ATTEMPTS = 2  # attempts of a read on a bench that records incidents; else 1
WAITS = 2  # time-outs that an attempt can last: after a failed one, the link must first fall silent
PATIENCE = 20.0  # s that the driving thread may spend on a silent device, on computing, or on the disk
LONGEST = PATIENCE / (READ_ATTEMPTS * WAITS)  # s, longest time-out of a link


def longest(link: Link, guards: bool, watchdog: float) -> float:
    """The longest time-out that a link can have [s].

    Args:
        link: the link.
        guards: whether the device with the watchdog is on it.
        watchdog: time-out of the watchdog [s].
    """
    if guards and not isinstance(link, CanBus):  # what feeds a watchdog on Modbus waits for its turn on the link
        return min(watchdog / READ_ATTEMPTS, LONGEST)
    return LONGEST


def impatient(link: Link, guard: str, watchdog: float, *, guards: bool) -> str:
    """What is wrong with the time-out of a link, with the remedy; empty: nothing. `guard` has the watchdog."""
    most = longest(link, guards, watchdog)
    if link.timeout <= most:
        return ""
    waited = (READ_ATTEMPTS if most < LONGEST else READ_ATTEMPTS * WAITS) * link.timeout
    why = (
        f"and the watchdog of {guard} ({show(watchdog, 's')}) is not fed meanwhile"
        if most < LONGEST
        else f"and after {show(PATIENCE, 's')} this program counts as hanging, so that the watchdog of {guard} acts"
    )
    return (
        f"timeout = {show(link.timeout, 's')}: a device that falls silent is waited for {show(waited, 's')}, {why}; "
        f'write timeout = "{show(most, "s")}" or less'
    )
