"""The common base of all faults: where they strike, and when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from pydantic import Field

from palpate.instrument.config import check
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.quantity import Seconds
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.places import Struck, Target, struck
from palpate.simulators.numbers import Numbers
from palpate.simulators.randomness import Stream

MOST = 100  # faults in a scene
LONGEST = 1e9  # s, three decades; far beyond, whole nanoseconds are no numbers of a clock any more
WHEN = ("at", "transaction", "probability")


class Fault(Numbers):
    """A `[[fault]]` of a scene.

    Attributes:
        on: device or link that has the fault.
        at: bench time at which it strikes; or
        transaction: number, from 1, of the request (on CAN: the frame) that it strikes; or
        probability: probability of striking a request, by the scene's seed.
        lasts: how long it goes on; 0: it strikes once, and a changed device stays changed.
    """

    targets: ClassVar[tuple[Target, ...]]

    kind: str
    on: str
    at: Seconds | None = Field(default=None, ge=0, le=LONGEST)
    transaction: int | None = Field(default=None, ge=1, strict=True)
    probability: float | None = Field(default=None, gt=0, le=1, strict=True)
    lasts: Seconds = Field(default=0.0, ge=0, le=LONGEST)

    def problem(self, place: Struck) -> str:
        """What is wrong with the combination of its parameters at this place; empty: nothing."""
        return ""

    @property
    def lasts_ns(self) -> int:
        return round(self.lasts * 1e9)


class Trigger:
    """Decides when a fault strikes, by its transactions: the same for the same scene and seed."""

    def __init__(self, fault: Fault, number: int, seed: int) -> None:
        from scipy.special import ndtri

        self._fault = fault
        self._stream = Stream(seed, "fault", number)
        self._threshold = float(ndtri(fault.probability)) if fault.probability is not None else None
        self._count = 0
        self.struck = 0  # number of struck transactions
        self._until_ns: int | None = None

    def strikes(self, now_ns: int) -> bool:
        """Whether the transaction that begins now is struck; to be asked once for each transaction."""
        self._count += 1
        struck = self._until_ns is not None and now_ns < self._until_ns
        if not struck and self._begins(now_ns):
            self._until_ns = now_ns + self._fault.lasts_ns
            struck = True
        self.struck += struck
        return struck

    def _begins(self, now_ns: int) -> bool:
        if self._threshold is not None:
            return bool(self._stream.normal(self._count - 1, 1)[0] < self._threshold)
        if self._fault.at is not None:
            return self._until_ns is None and now_ns >= round(self._fault.at * 1e9)
        return self._count == self._fault.transaction


def parse_faults(given: Sequence[Mapping[str, Any]], standing: Sequence[Struck], where: str) -> tuple[Fault, ...]:
    """Read and check the faults of a scene file.

    Raises:
        ConfigError: a kind, device or key is unknown, or there is not exactly one time. The message names the file, the
            number of the fault and the key.
    """
    if len(given) > MOST:
        raise ConfigError(f"{where}: fault: {len(given)} faults are more than {MOST}; leave some out")
    return tuple(
        parse_fault(dict(table), standing, f"{where}: fault {number}") for number, table in enumerate(given, 1)
    )


def parse_fault(table: dict[str, Any], standing: Sequence[Struck], where: str) -> Fault:
    """Read and check one fault; `where` names it in messages. Raises ConfigError as `parse_faults` does."""
    kind = table.get("kind")
    if not isinstance(kind, str):
        raise ConfigError(f"{where}: kind: is missing or no text; valid: {', '.join(FAULTS)}")
    try:
        fault: Fault = check(table, fault_class(kind), where)
        valid = struck(fault.targets, standing)
        if fault.on not in valid:
            raise UnknownName(f"place of a {kind}", fault.on, valid)
    except UnknownName as error:
        raise ConfigError(f"{where}: {error}") from None
    times = [name for name in WHEN if getattr(fault, name) is not None]
    if len(times) != 1:
        said = " and ".join(times) or "none"
        raise ConfigError(f"{where}: {said} given of {', '.join(WHEN)}: exactly one says when it strikes")
    if problem := fault.problem(valid[fault.on]):
        raise ConfigError(f"{where}: {problem}")
    return fault
