"""What of a map serves each role: a model of the table `[role.ROLE]` for each role that a maker's device can fill."""

from __future__ import annotations

from palpate.instrument.bench.role_maps.bias import BiasMap
from palpate.instrument.bench.role_maps.exciter import ExciterMap
from palpate.instrument.bench.role_maps.load_indicator import LoadIndicatorMap
from palpate.instrument.bench.role_maps.positioner import PositionerMap
from palpate.instrument.bench.role_maps.role_map import RoleMap
from palpate.instrument.bench.role_maps.sensor_node import SensorNodeMap

ROLE_MAPS: dict[str, type[RoleMap]] = {  # by role
    "bias": BiasMap,
    "exciter": ExciterMap,
    "load_indicator": LoadIndicatorMap,
    "positioner": PositionerMap,
    "sensor_node": SensorNodeMap,
}
