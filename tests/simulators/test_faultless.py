"""A scene without faults pays nothing for those that others have."""

from __future__ import annotations

import sys

import pytest

from simulators.scene import read_scene
from tests.operations import operations

FAR = {"on": "signal_generator", "kind": "no_reply", "transaction": 1_000_000}


def test_a_scene_without_faults_does_the_same_operations_where_there_is_no_code_for_any(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = read_scene("thesis_single")
    operations(scene)  # fills what is kept between benches
    with_code = operations(scene)
    assert operations(scene.with_faults([FAR])) != with_code
    for name in [name for name in sys.modules if name.startswith("simulators.faults")]:
        monkeypatch.setitem(sys.modules, name, None)
    assert operations(scene) == with_code
    with pytest.raises(ImportError):
        operations(scene.with_faults([FAR]))
