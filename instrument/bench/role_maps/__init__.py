"""What of a map serves each role: a model of the table `[role.ROLE]` for each role that a maker's device can fill."""

from __future__ import annotations

from palpate.instrument.bench.role_maps.load_indicator import LoadIndicatorMap
from palpate.instrument.bench.role_maps.role_map import RoleMap

ROLE_MAPS: dict[str, type[RoleMap]] = {"load_indicator": LoadIndicatorMap}  # by role
