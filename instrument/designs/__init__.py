"""The sensor designs, by name."""

from __future__ import annotations

from instrument.design import Design
from instrument.designs.array import ARRAY, array_of
from instrument.designs.common_base import COMMON_BASE
from instrument.designs.different_base import DIFFERENT_BASE
from instrument.designs.single import SINGLE
from instrument.designs.single_round import SINGLE_ROUND
from instrument.errors import named

DESIGNS: dict[str, Design] = {
    design.name: design for design in (SINGLE, SINGLE_ROUND, COMMON_BASE, DIFFERENT_BASE, ARRAY, array_of(16))
}


def get_design(name: str) -> Design:
    """The design of that name.

    Raises:
        UnknownName: no such design.
    """
    return named("design", name, DESIGNS)
