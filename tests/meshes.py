"""Meshes of the solid model that are smaller than its own, for what holds on any."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.instrument.models.solid import ladders
from palpate.instrument.models.solid.ladders import Resolution


def give(monkeypatch: pytest.MonkeyPatch, *resolutions: Resolution) -> None:
    """Let every sensor of the solid model have these meshes in place of its own."""
    for name in ("OF_FEW_TEETH", "OF_MANY_TEETH"):
        monkeypatch.setattr(ladders, name, replace(getattr(ladders, name), resolutions=resolutions))
