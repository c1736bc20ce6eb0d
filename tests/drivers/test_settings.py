"""A device that no longer holds what was written is noticed, told by name and value, and set right."""

from __future__ import annotations

import math
import re

import pytest

from palpate.drivers.bench import Bench
from palpate.instrument.errors import BenchError, DeviceError, SettingsLost
from palpate.simulators.bench import SimulatedBench
from tests.drivers.benches import drive, open_bench

# --- a bench ---------------------------------------------------------------------------------------------


def test_a_bench_whose_devices_have_served_others_opens_without_a_difference(sim: SimulatedBench) -> None:
    """The generator counts its writes for ever: those from before do not count."""
    for _ in range(2):
        with open_bench(sim) as bench:
            bench.check_settings()


def test_an_opened_bench_holds_what_its_file_says(bench: Bench, sim: SimulatedBench) -> None:
    said = {device.name: device.settings for device in bench.description.devices}
    assert sim.amplifier.settings["gain"] == said["shaker_amplifier"].gain
    assert sim.amplifier.settings["current_limit"] == said["shaker_amplifier"].current_limit
    assert sim.indicator.settings["gage_factor"] == said["strain_indicator"].gage_factor
    assert sim.indicator.settings["full_scale"] == 1e3 * said["strain_indicator"].full_scale
    sim.amplifier.settings["enable"] = 0.0
    sim.generator.settings["amplitude"] = 3.0
    bench.drive()
    assert bench.device("signal_generator").read() == (10.0, 0.0, 0.0)
    bench.rest()
    assert bench.device("signal_generator").read() == (10.0, 0.0, 0.0)


def test_a_bench_whose_load_cell_reads_nothing_does_not_go_on(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = {"status": 4.0, "reading_float": math.nan, "reading": 0.0}
    read = sim.indicator.read
    monkeypatch.setattr(sim.indicator, "read", lambda name: opened[name] if name in opened else read(name))
    with pytest.raises(DeviceError, match="bridge open; check the bridge and its wires") as caught:
        bench.recover()
    assert caught.value.device == bench.device("strain_indicator").name


def test_what_was_lost_and_written_again_is_told_to_the_record(bench: Bench, sim: SimulatedBench) -> None:
    told = list[str]()
    bench.attend(lambda _kind, what, _ns: told.append(what))
    sim.amplifier.settings["gain"] = 7.0
    with pytest.raises(
        SettingsLost, match=f"{re.escape(bench.device('shaker_amplifier').name)}: gain is 7, was set to .*; look at"
    ):
        bench.check_settings()
    bench.recover()
    assert [what for what in told if what.startswith(f"{bench.device('shaker_amplifier').name}: gain is 7")] != []
    assert all(what.endswith("; written again") for what in told if "was set to" in what)
    bench.check_settings()


@pytest.mark.parametrize(("errors", "told"), [(0, []), (3, ["3 error frames"])])
def test_error_frames_of_the_bus_are_told(
    errors: int, told: list[str], bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted = list[str]()
    bench.attend(lambda _kind, what, _ns: noted.append(what))
    link = bench.device("sensor_node_1").link
    monkeypatch.setattr(link, "error_frames", lambda: errors)
    bench.check_settings()
    assert noted == [f"{link.name}: {each}" for each in told]


def test_what_comes_after_a_bench_is_closed_is_not_told_to_its_record(sim: SimulatedBench) -> None:
    told = list[str]()
    with open_bench(sim) as bench:
        bench.attend(lambda _kind, what, _ns: told.append(what))
    bench.incidents.note("too late")
    assert told == []


@pytest.mark.parametrize("safe", [True, False])
def test_an_amplifier_is_given_up_only_when_all_outputs_are_off(
    safe: bool, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If an output cannot be switched off, the watchdog must do it, for which the owner must fall silent."""
    bench = open_bench(sim)
    bench.__enter__()
    drive(bench)
    released = list[bool]()
    release = bench.device("shaker_amplifier").release
    monkeypatch.setattr(bench.device("shaker_amplifier"), "release", lambda: released.append(True) or release())
    if safe:
        bench.__exit__(None, None, None)
    else:
        monkeypatch.setattr(bench.device("signal_generator"), "output", lambda _on: _fails())
        with pytest.raises(BenchError, match="could not all be switched off: it is stuck"):
            bench.__exit__(None, None, None)
    assert released == ([True] if safe else [])


def _fails() -> None:
    raise DeviceError("it is stuck")


def test_a_bench_that_cannot_be_opened_gives_its_amplifier_up(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise the next program would have to wait for the watchdog."""
    bench = open_bench(sim)
    monkeypatch.setattr(bench.device("positioner"), "connect", _fails)
    with pytest.raises(DeviceError, match="it is stuck"):
        bench.__enter__()
    assert sim.amplifier.read("token") == 0
    assert not bench.is_open
