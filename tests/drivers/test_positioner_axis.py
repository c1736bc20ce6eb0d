"""Private names hold an axis, or begin a move without its wait: no door lets a program die in the middle of one."""

from __future__ import annotations

import pytest

from palpate.extend import DeviceError
from tests.drivers.test_positioners import C5, CS2RS, KRD, KRD_CAN, opened, served
from tests.procedures.conftest import happens_in


@pytest.mark.parametrize(
    ("kind", "stops"),
    [(KRD, True), *[pytest.param(*p, marks=pytest.mark.slow) for p in ((KRD_CAN, True), (C5, False), (CS2RS, False))]],
)
def test_a_device_that_watches_its_master_stops_when_it_is_gone(kind: str, stops: bool) -> None:
    with opened(kind) as (sim, _twin, stage):
        stage.home()
        stage._target = None
        stage._begin(stage._move(10e-3, 10e-3, 1e-3)[0])
        sim.clock.wait(20.0)
        if not stops:
            assert sim.rig.position == pytest.approx(10e-3)  # their pages say so
            return
        assert sim.rig.position == pytest.approx(1e-3, abs=5e-5)
        (said,) = [each for each in stage.differences() if "alarm" in each]
        assert ("alarm = 0x85" in said) == (kind == KRD)
        stage.restore()
        stage.move(2e-3)
        sim.clock.wait(20.0)  # nobody needs to renew a move that has ended
        assert stage.differences() == []


@pytest.mark.slow
def test_a_move_that_does_not_arrive_in_time_is_stopped_and_told() -> None:
    with opened(CS2RS) as (sim, twin, stage):
        stage.home()
        happens_in(sim, 0.5, lambda: twin._axis.go(sim.clock.now_ns(), 20_000, 1.0, 1e9, 1e9))  # it is held
        with pytest.raises(DeviceError, match=r"stands at 0\.4\d+ mm after 9\.\d+ s, was sent to 2 mm; it was stopped"):
            stage.move(2e-3)
        assert not twin._axis.moving


@pytest.mark.parametrize("kind", ["oriental-motor-blvd-krd", "leadshine-cs2rs"])
def test_a_target_that_somebody_writes_alone_starts_no_move(kind: str) -> None:
    with served(kind) as (_sim, twin):
        target = twin.kind.serves["positioner"].target
        twin.turn({target: 5.0})
        assert (twin.settings[target], twin._axis.moving) == (5.0, False)


@pytest.mark.slow
def test_a_home_is_not_looked_for_in_a_way_that_takes_the_present_position() -> None:
    with opened(C5) as (sim, twin, stage):
        stage.home()
        stage.move(2e-3)
        twin.settings["homing_method"] = 35.0  # it was never saved, and the power has gone
        stage._knows_home = False
        with pytest.raises(DeviceError, match="homing_method is 35"):
            stage.home()
        assert sim.rig.position == pytest.approx(2e-3)
