"""A scene without faults pays nothing for those that others have."""

from __future__ import annotations

import pytest

from palpate.simulators.planning.settle import read_scene, with_faults
from tests.operations import operations, without_code_of_faults

FAR = {"on": "signal_generator", "kind": "no_reply", "transaction": 1_000_000}


def test_a_scene_without_faults_does_the_same_operations_where_there_is_no_code_for_any() -> None:
    scene = read_scene("thesis_single")
    operations(scene)  # fills what is kept between benches
    with_code = operations(scene)
    faulty = with_faults(scene, [FAR])
    assert operations(faulty) != with_code
    with without_code_of_faults():
        assert operations(scene) == with_code
        with pytest.raises(ImportError):
            operations(faulty)
