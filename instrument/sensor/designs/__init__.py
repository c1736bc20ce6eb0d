"""The sensor designs, by name."""

from __future__ import annotations

from palpate.instrument.errors import named
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs.array import ARRAY, array_of
from palpate.instrument.sensor.designs.common_base import COMMON_BASE
from palpate.instrument.sensor.designs.different_base import DIFFERENT_BASE
from palpate.instrument.sensor.designs.single import SINGLE
from palpate.instrument.sensor.designs.single_round import SINGLE_ROUND

DESIGNS: dict[str, Design] = {
    design.name: design for design in (SINGLE, SINGLE_ROUND, COMMON_BASE, DIFFERENT_BASE, ARRAY, array_of(16))
}


def get_design(name: str) -> Design:
    """The design of that name.

    Raises:
        UnknownName: no such design.
    """
    return named("design", name, DESIGNS)
