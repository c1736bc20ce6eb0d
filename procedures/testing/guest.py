"""A bench with one device beside the usual ones."""

from __future__ import annotations

import functools

from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene

NAME = "device"


@functools.cache
def guest_scene(kind: str) -> Scene:
    """The thesis' scene with a device of that kind, or with the usual ones alone where the kind is empty."""
    scene = read_scene("thesis_single")
    return scene.with_devices({NAME: {"kind": kind}}) if kind else scene
