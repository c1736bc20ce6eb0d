"""Procedures on twins of devices that can be bought: it finds what it finds on ours, or says why not."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from tests.fault_matrix import Found, undisturbed
from tests.fault_procedures import real_bench, scene
from tests.procedures.conftest import Palpate

POSITIONERS = {"leadshine-cs2rs": 1e-7, "oriental-motor-blvd-krd": 1e-6}  # m of a step, by kind


def agree(theirs: Found, ours: Found) -> None:
    """All values stand without a mark, and differ from ours by what both may."""
    assert theirs.keys() == ours.keys()
    for name, each in theirs.items():
        assert each.valid, name
        assert each.value == pytest.approx(ours[name].value, abs=math.hypot(each.allowed, ours[name].allowed)), name


@pytest.mark.slow
@pytest.mark.parametrize(
    "procedure",
    ["sweep position", "calibrate load-cell", "test modulus", "characterise"],
)
def test_a_procedure_finds_on_real_bench_what_it_finds_on_ours(procedure: str) -> None:
    theirs, ours = (undisturbed(procedure, of=of)[0] for of in (real_bench, scene))
    agree(theirs, ours)


@pytest.mark.slow
def test_a_frequency_sweep_as_far_as_its_devices_can_and_no_further(palpate: Palpate) -> None:
    sweep = ("sweep", "frequency", "--scene", "real_bench", "--json", "--frequencies")
    said = palpate(*sweep, "2 Hz, 5 Hz, 10 Hz")
    assert said.status == 0, said.err
    assert [(each["frequency_Hz"], each["valid"]) for each in said.object["points"]] == [
        (2.0, True),
        (5.0, True),
        (10.0, True),
    ]
    said = palpate(*sweep, "2 Hz, 5 Hz, 20 Hz", "--out", "refused")
    assert "load_cell: its readings (filter_level = 0: 17 Hz, 600 a second) lose up to 48 %" in said.complaint
    assert not Path("refused").exists()


def on_one_line(positioner: str, procedure: str) -> Scene:
    """The bench whose positioner is on the serial line of the indicator, which is of another maker."""
    devices = dict(read_scene("real_bench").file.device or {})
    devices["stage"] = {**devices["stage"], "kind": positioner, "metres_per_step": POSITIONERS[positioner]}
    return scene(procedure).with_devices(devices)


@pytest.mark.slow
@pytest.mark.parametrize("positioner", POSITIONERS)
def test_devices_of_two_makers_share_a_serial_line_in_a_whole_sweep(positioner: str) -> None:
    theirs, _ = undisturbed("sweep loads", of=lambda name: on_one_line(positioner, name))
    agree(theirs, undisturbed("sweep loads")[0])
