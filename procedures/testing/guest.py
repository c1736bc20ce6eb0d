"""A scene whose bench has one additional device, for the conformance suites."""

from __future__ import annotations

import functools

from palpate.instrument.bench.kinds import device_kind
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene

NAME = "device"


@functools.cache
def guest_scene(kind: str) -> Scene:
    """The scene thesis_single with an additional device of a kind, in its first role; none if `kind` is empty."""
    scene = read_scene("thesis_single")
    if not kind:
        return scene
    roles = device_kind(kind).roles
    return scene.with_devices({NAME: {"kind": kind, **({"role": roles[0]} if roles else {})}})
