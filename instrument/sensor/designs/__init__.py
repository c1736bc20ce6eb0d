"""The sensor designs, by name: ours, and those of installed packages.

[project.entry-points."palpate.designs"]
grasper_7 = "grasper_7:DESIGN"
"""

from __future__ import annotations

from palpate.instrument.additions import find, unusable
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs.array import ARRAY, array_of
from palpate.instrument.sensor.designs.common_base import COMMON_BASE
from palpate.instrument.sensor.designs.different_base import DIFFERENT_BASE
from palpate.instrument.sensor.designs.single import SINGLE
from palpate.instrument.sensor.designs.single_round import SINGLE_ROUND

DESIGNS: dict[str, Design] = {
    design.name: design for design in (SINGLE, SINGLE_ROUND, COMMON_BASE, DIFFERENT_BASE, ARRAY, array_of(16))
}

GROUP, WHAT = "palpate.designs", "design"


def get_design(name: str) -> Design:
    """The design of that name.

    Raises:
        UnknownName: there is no design of that name.
        ConfigError: the package that adds it cannot be used.
    """
    if name in DESIGNS:
        return DESIGNS[name]
    found, design = find(GROUP, WHAT, name, DESIGNS)
    if not isinstance(design, Design) or design.name != name:
        raise unusable(found, WHAT, f"is no Design that is called {name!r}")
    return design
