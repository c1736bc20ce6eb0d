"""What a search for devices has found, and how long it may go on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from palpate.drivers.clock import Clock, WallClock
from palpate.instrument.bench.kinds import LinkKind
from palpate.instrument.bench.links import Link


@dataclass(frozen=True)
class FoundDevice:
    """A device that answers.

    Attributes:
        kind: kind of its link.
        link: its link, with the settings at which it answers.
        unit: its unit id or node id.
        says: what it says of itself; "": nothing.
        serial: its serial number; "": it tells none.
        fits: kinds of device of which all marks or the whole identity fit.
        candidates: kinds that tell nothing by which they are known, and of which it has the registers or objects.
        doubt: why the kind that fits cannot be used as it is, such as another unit than the map's; "": it can.
        simulated: whether it says that it is simulated.
    """

    kind: LinkKind
    link: Link
    unit: int
    says: str = ""
    serial: str = ""
    fits: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()
    doubt: str = ""
    simulated: bool = False

    @property
    def identified(self) -> bool:
        """Whether one kind alone fits."""
        return len(self.fits) == 1


@dataclass
class Search:
    """A search that goes on: what it has found until now, and what else there is to tell.

    Attributes:
        within: longest time that it may take [s].
        clock: tells how much of it has passed.
        asked: number of addresses that were asked.
        of: number of addresses that will be asked at most.
        progress: called with `asked`, `of` and what is asked now.
        found: devices that answer.
        heard: what was heard at addresses that do not answer properly, as texts for people.
        left: what was not asked, and why, as texts for people.
    """

    within: float = 600.0
    clock: Clock = field(default_factory=WallClock)
    asked: int = 0
    of: int = 0
    progress: Callable[[int, int, str], object] = lambda _asked, _of, _what: None
    found: list[FoundDevice] = field(default_factory=list)
    heard: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)

    def goes_on(self, what: str) -> bool:
        """Tell what is asked next. False: the time is over, and nothing more is asked."""
        if self.over:
            return False
        self.progress(self.asked, self.of, what)
        self.asked += 1
        return True

    @property
    def over(self) -> bool:
        """Whether its time is over."""
        return self.clock.now_ns() > 1e9 * self.within
