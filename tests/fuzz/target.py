"""One decoder under hostile input: what it takes, and the property it is held to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from palpate.instrument.errors import PalpateError


class WronglyAcceptedError(AssertionError):
    """A decoder gave a value that the bytes do not hold."""


@dataclass(frozen=True, slots=True)
class Target:
    """A decoder.

    Attributes:
        seeds: good inputs, which it must accept.
        decode: what a value decoded from the input is compared with lies in here: returns after a value that an
            independent reading of the same bytes gives too, raises PalpateError where the input is refused, and
            WronglyAcceptedError where the two differ.
        words: pieces that mutations put in.
    """

    seeds: Sequence[bytes]
    decode: Callable[[bytes], None]
    words: Sequence[bytes] = ()

    def accepts(self, data: bytes) -> bool:
        """False where the input is refused; whatever else is raised is a finding."""
        try:
            self.decode(data)
        except PalpateError:
            return False
        return True


def require(same: bool, what: str, *details: object) -> None:
    """Raises WronglyAcceptedError."""
    if not same:
        raise WronglyAcceptedError(f"{what}: {', '.join(map(repr, details))}"[:1000])


def same_number(one: float, other: float) -> bool:
    """Equal to rounding, or both NaN."""
    return one == other or math.isclose(one, other, rel_tol=1e-14) or (math.isnan(one) and math.isnan(other))
