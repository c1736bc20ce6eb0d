"""Time and memory of an elimination, known from its order before anything of it is computed."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.errors import EstimateError
from palpate.instrument.notice import price

if TYPE_CHECKING:
    from palpate.instrument.models.finite_elements.dissection import Order

RATE = 1e10  # multiplications in a second of large matrices, on one core of a server of 2020 [M]
# What else takes time, in the time of so many multiplications [M]: to make one entry of an element's matrix and add it;
# and all that is done with one of the matrix that is left.
OF_ELEMENT, OF_LEFT = 45, 330
# Matrices of the kept unknowns that exist at once while their poles are found.
COPIES = 10
# Least share of the free memory that is left to everything else.
LEFT = 0.1


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of an elimination, or of several, one after the other.

    Attributes:
        operations: number of multiplications.
        entries: greatest number of matrix entries that exist at once.
        unknowns: number of unknowns of the greatest.
    """

    operations: float = 0.0
    entries: int = 0
    unknowns: int = 0

    def __add__(self, other: Cost) -> Cost:
        return Cost(
            self.operations + other.operations,
            max(self.entries, other.entries),
            max(self.unknowns, other.unknowns),
        )

    @property
    def seconds(self) -> float:
        """Processor time [s]."""
        return self.operations / RATE

    @property
    def bytes(self) -> int:
        """Memory."""
        return 8 * self.entries


def total(costs: Iterable[Cost]) -> Cost:
    """The cost of several eliminations, one after the other."""
    return sum(costs, Cost())


def of_elimination(order: Order, elements: tuple[int, int], loads: int, at_once: int, remembers: bool = False) -> Cost:
    """The cost of an elimination by its order.

    Args:
        order: the order.
        elements: number of elements, and of the unknowns of each.
        loads: number of loads.
        at_once: number of elements whose matrices exist at once.
        remembers: whether the factors are kept.
    """
    count, size = elements
    own = order.inside / count  # unknowns inside an element, on average
    rest = size - own
    unknowns = len(order.rank)
    kept = unknowns - order.eliminated
    operations = order.operations + count * (own**3 / 6 + own**2 * rest / 2 + own * rest**2 / 2)
    entries = order.entries + 2 * unknowns * loads + min(at_once, count) * size**2 + COPIES * kept**2
    if remembers:
        entries += sum(front.count * front.size for front in order.fronts)
    return Cost(operations + OF_ELEMENT * count * size**2 + OF_LEFT * kept**2, entries, unknowns)


def require_memory(cost: Cost, remedy: str) -> None:
    """Check that what an elimination needs fits into the memory that is free. Raises EstimateError."""
    if not fits(cost):
        raise EstimateError(
            f"finite elements: a mesh of {cost.unknowns} unknowns needs {cost.bytes / 1e9:.1f} GB of memory, and "
            f"{(free_memory() or 0) / 1e9:.1f} GB are free; {remedy}"
        )


def fits(cost: Cost) -> bool:
    """Whether what an elimination needs fits into the memory that is free, as far as the system tells."""
    has = free_memory()
    return has is None or cost.bytes <= (1 - LEFT) * has


def judge(cost: Cost, remedy: str, then: str = "") -> None:
    """Before anything is computed, refuse what does not fit into memory, and say how long it takes if it takes long.

    Args:
        cost: the cost.
        remedy: what to do if it does not fit, as "give a larger tolerance".
        then: what follows, as "; its answers are kept".

    Raises:
        EstimateError: it does not fit.
    """
    require_memory(cost, remedy)
    price(f"setting up meshes of up to {cost.unknowns} unknowns", cost.seconds, then)


def free_memory() -> int | None:
    """Memory that this process may still take, in bytes; None: the system does not tell."""
    known = [each for each in (_available(), _in_group(), _in_limit()) if each is not None]
    return min(known, default=None)


def _available() -> int | None:
    """What the machine has left, with what its caches would give up."""
    try:
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    except (OSError, ValueError):
        pass
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def _in_group() -> int | None:
    """What the limit of a container leaves."""
    group = Path("/sys/fs/cgroup")
    try:
        most = int((group / "memory.max").read_text(encoding="ascii"))
        return max(0, most - int((group / "memory.current").read_text(encoding="ascii")))
    except (OSError, ValueError):  # there is no limit
        return None


def _in_limit() -> int | None:
    """What `ulimit -v` leaves."""
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    if most == resource.RLIM_INFINITY:
        return None
    try:
        taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        taken = 0
    return max(0, most - taken)
