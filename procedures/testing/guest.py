"""A scene whose bench has one additional device, for the conformance suites."""

from __future__ import annotations

import functools

from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene

NAME = "device"


@functools.cache
def guest_scene(kind: str) -> Scene:
    """The scene thesis_single with an additional device of a kind; without one if `kind` is empty."""
    scene = read_scene("thesis_single")
    return scene.with_devices({NAME: {"kind": kind}}) if kind else scene
