"""All decoders, by name."""

from __future__ import annotations

from importlib import import_module

from tests.fuzz.target import Target

# Where a decoder is, and how many of a thousand inputs it gets: fast ones more, and what comes over a wire.
TARGETS = {
    "modbus_tcp": ("modbus:tcp", 160),
    "modbus_rtu": ("modbus:rtu", 120),
    "sdo_answers": ("can:sdo_answers", 150),
    "node_frames": ("can:node_frames", 150),
    "fields": ("contracts:fields", 300),
    "quantities": ("quantities:quantities", 60),
    "bench_files": ("files:bench", 24),
    "scene_files": ("files:scene", 8),
    "load_cell_calibrations": ("files:load_cell", 12),
    "film_calibrations": ("files:films", 8),
    "price_lists": ("files:prices", 3),
    "surfaces": ("files:surface", 3),
    "runs": ("runs:run", 2),
}


def target(name: str) -> Target:
    """Raises KeyError."""
    module, function = TARGETS[name][0].split(":")
    made: Target = getattr(import_module(f"tests.fuzz.{module}"), function)()
    return made
