"""Who mounts the samples of a bench, and how long that takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from palpate.instrument.bench.kinds import DeviceKind, Role

MOUNTING = 60.0  # s that a person takes to change the sample [A]


@dataclass(frozen=True, slots=True)
class Mounts:
    """Who mounts the samples of a bench, and how long that takes; a person, unless a sample changer does.

    Attributes:
        seconds: time of one mounting [s].
        changer: whether a sample changer mounts them.
    """

    seconds: float = MOUNTING
    changer: bool = False

    @property
    def again(self) -> float:
        """Time in which an object that lies there already is taken off and laid there anew [s].

        A changer leaves what it is told to lay and lies there already: it lays another sample in between.
        """
        return 2 * self.seconds if self.changer else self.seconds

    @property
    def person(self) -> float:
        """The part of a mounting that a person takes [s]."""
        return 0.0 if self.changer else self.seconds

    def described(self, mountings: int, again: bool = False) -> str:
        """Who takes how long of a plan for so many mountings, which are `again` those of one object; for people."""
        following = self.again if again else self.seconds
        seconds = self.seconds + (mountings - 1) * following
        return f"{'sample changer' if self.changer else 'person'} {seconds:g} s"


BY_HAND = Mounts()


def mounts_by(kind_in: Callable[[Role], DeviceKind | None]) -> Mounts:
    """Who mounts the samples of a bench; `kind_in` gives the kind that fills a role.

    A kind of changer that does not say how long it takes counts as long as a person.
    """
    changer = kind_in("sample_changer")
    return BY_HAND if changer is None else Mounts(changer.exchange or MOUNTING, changer=True)
