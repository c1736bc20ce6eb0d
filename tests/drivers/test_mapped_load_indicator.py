"""Load indicators of makers: what they show becomes mV of the load cell, and what they lack is made up or refused."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from palpate.drivers.devices.device import Device
from palpate.drivers.devices.load_indicator import LARGEST_LOSS, POLLS, Following, MappedLoadIndicator, pauses
from palpate.drivers.roles import why_invalid
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.bench.role_maps import LoadIndicatorMap, LoadIndicatorSettings, LowPass
from palpate.instrument.contracts.field import Value
from palpate.instrument.errors import DeviceError, RangeError
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.load_indicator import SimulatedMappedLoadIndicator, low_passed
from palpate.simulators.rig import IDEAL_SENSITIVITY
from palpate.simulators.wire.device import SimulatedPlace

FREQUENCY = 10.0  # Hz
KINDS = ("flintec-dad-141", "laumas-tlb4", "seneca-z-sg2")
SECTIONS: dict[str, dict[str, Any]] = {
    "flintec-dad-141": {"filter": 0},
    "laumas-tlb4": {"bandwidth": "80 Hz"},
    "seneca-z-sg2": {"bandwidth": "60 Hz", "rate": "151 Hz", "resolution": 0.001},
}
SPAN = 1e3 * IDEAL_SENSITIVITY  # mV/N: the displays are in newtons


class Rig:
    """A load cell under a sine, a standing force, or both."""

    def __init__(self) -> None:
        self.effects: Any = SimpleNamespace(cell=None)
        self.scene: Any = SimpleNamespace(seed=1)
        self.changes = 0
        self.standing, self.swing = 0.0, 0.0

    def load(self, standing: float, swing: float = 0.0) -> None:
        self.standing, self.swing = standing, swing
        self.changes += 1

    def cell_force(self, time_ns: Any, _step_ns: int = 0) -> Any:
        return self.standing + self.swing / 2 * np.sin(2e-9 * math.pi * FREQUENCY * np.asarray(time_ns))


class Wire(Device):
    """Reads and writes a twin without a bus."""

    twin: SimulatedMappedLoadIndicator

    def get(self, name: str) -> float:
        return self.get_many(name)[0]

    def get_many(self, *names: str) -> list[float]:
        found = []
        for name in names:
            beside = {each: self.twin.read(each) for each in self.contract[name].beside}
            data = self.contract.pack(name, self.twin.read(name), beside)
            found.append(self.contract.decode(name, data, beside))
        return found

    def held(self, name: str) -> float:
        return self.get(name)

    def give(self, **values: Value) -> None:
        self.twin.write({name: self.contract.raw(name, value) for name, value in values.items()})

    def differences(self) -> list[str]:
        return []


class Straight(MappedLoadIndicator, Wire):
    """The driver on such a wire."""


def indicator(kind: str, section: dict[str, Any] | None = None, set_up: bool = True, **role: Any) -> Straight:
    """A driver and its twin under a rig of its own; `role`: keys of the map's table that are others."""
    found = device_kind(kind)
    table = found.serves["load_indicator"].model_copy(update=role)
    found = replace(found, serves={"load_indicator": table})
    settings = LoadIndicatorSettings(**{"span": SPAN} | (SECTIONS[kind] if section is None else section))
    clock = VirtualClock()
    rig: Any = Rig()
    device = Straight("cell", clock, found.contract)
    device.twin = SimulatedMappedLoadIndicator.at(
        SimulatedPlace(clock, rig, 1, "SIM-1", settings, found, lambda _role: None)
    )
    device.kind = found
    clock.wait(2.0)
    if set_up:
        device.set_up(settings, 1.0)
    return device


def shaken(device: Straight, swing: float) -> None:
    """The device reads peak to peak, and the load has swung by this much [N] for a while."""
    device.check_frequency(FREQUENCY)
    device.peak_to_peak(0.5)
    device.twin.rig.load(3.0, swing)
    device.clock.wait(1.0)


@pytest.mark.parametrize("kind", KINDS)
def test_what_it_shows_becomes_millivolts_of_the_load_cell(kind: str) -> None:
    device = indicator(kind)
    device.track(0.1)
    for load in (3.0, -2.0):
        device.twin.rig.load(load)
        device.clock.wait(2.0)
        found = device.read()
        assert found.valid
        assert found.reading_mV == pytest.approx(SPAN * load, abs=device.resolution_mV)
    assert device.resolution_mV == pytest.approx(1e-3 * SPAN)


@pytest.mark.parametrize("kind", KINDS)
def test_a_peak_to_peak_load_is_right_within_what_it_says_of_itself(kind: str) -> None:
    device = indicator(kind)
    shaken(device, 4.0)
    found = device.read()
    assert found.valid
    assert found.difference
    assert 0 < found.u_mV < 0.05 * found.reading_mV
    assert abs(found.reading_mV - 4.0 * SPAN) <= 2 * found.u_mV + device.resolution_mV


def test_a_load_that_moves_is_not_stable_with_a_bit_for_it_or_without() -> None:
    for role in ({}, {"stable": ""}, {"stable": "not tare_set"}):
        device = indicator("flintec-dad-141", **role)
        device.track(0.013)
        device.twin.rig.load(3.0, 1.0)
        device.clock.wait(1.0)
        assert not device.read().stable
        device.twin.rig.load(3.0)
        device.clock.wait(1.0)
        assert device.read().stable


def test_repeated_readings_that_do_not_agree_tell_by_how_much_and_what_helps() -> None:
    device = indicator("seneca-z-sg2", stable="")
    device.track(0.013)
    device.twin.rig.load(3.0, 1.0)
    device.clock.wait(1.0)
    said = why_invalid(device.read())
    assert re.match(r"3 readings differ by 0\.\d+ N, one step is 0\.001 N; .* write a resolution", said)
    device.twin.rig.load(3.0)
    device.clock.wait(1.0)
    assert why_invalid(device.read()) == ""


def test_greatest_and_least_readings_make_a_peak_to_peak_value() -> None:
    both = indicator("flintec-dad-141", peak_to_peak="", greatest="peak", least="valley")
    true = indicator("flintec-dad-141")
    readings = []
    for device in (both, true):
        shaken(device, 2.0)
        readings.append(device.read().reading_mV)
    assert readings[0] == pytest.approx(readings[1], abs=1.01e-3 * SPAN)


def test_extremes_are_those_since_the_last_reading_began() -> None:
    device = indicator("flintec-dad-141")
    device.check_frequency(FREQUENCY)
    device.peak_to_peak(0.5)
    for swing in (4.0, 1.0):
        device.twin.rig.load(3.0, swing)
        device.clock.wait(1.0)
        assert device.read().reading_mV == pytest.approx(swing * SPAN, rel=0.03)


def test_the_filter_of_the_factory_cuts_the_force_and_is_refused_by_name_with_what_helps() -> None:
    device = indicator("flintec-dad-141", {})
    with pytest.raises(RangeError, match=r"filter_level = 3: 4 Hz.* lose up to 63 % .*10 Hz.*write filter = 0"):
        device.check_frequency(FREQUENCY)
    device.check_frequency(1.0)
    device.twin.settings["filter_kind"] = 1.0
    with pytest.raises(RangeError, match=r"filter_kind reads fir; .* for iir alone"):
        device.check_frequency(1.0)


@pytest.mark.parametrize(
    ("kind", "section", "says"),
    [
        ("flintec-dad-141", {"filter": 9}, "filter = 9 is no level of its filter; valid: 0, 1"),
        ("laumas-tlb4", {"filter": 0}, "no field of its map sets one"),
        ("seneca-z-sg2", {}, "write resolution = NUMBER in its section"),
        ("flintec-dad-141", {"bandwidth": "18 Hz"}, "the device itself tells its bandwidth; leave it out"),
        ("laumas-tlb4", {"resolution": 0.01}, "the device itself tells its resolution; leave it out"),
    ],
)
def test_a_section_that_the_device_cannot_have_is_refused(kind: str, section: dict[str, Any], says: str) -> None:
    with pytest.raises(RangeError, match=says):
        indicator(kind, section)


@pytest.mark.parametrize(
    ("kind", "section", "frequency", "says"),
    [
        ("laumas-tlb4", {}, 0.5, 'write bandwidth = "NUMBER Hz"'),
        ("seneca-z-sg2", {"bandwidth": "60 Hz", "resolution": 0.001}, FREQUENCY, r"12\.5 a second"),
    ],
)
def test_a_frequency_that_it_may_not_follow_is_refused(
    kind: str, section: dict[str, Any], frequency: float, says: str
) -> None:
    with pytest.raises(RangeError, match=says):
        indicator(kind, section).check_frequency(frequency)


def test_a_display_whose_step_changes_stops_by_name() -> None:
    for kind, field, value in (("flintec-dad-141", "display_step", 0.002), ("laumas-tlb4", "division", 12.0)):
        device = indicator(kind)
        device.twin.settings[field] = value
        with pytest.raises(DeviceError, match=f"{field} says .* before, so the display has changed"):
            device.differences()


def test_a_filter_that_somebody_changes_is_told() -> None:
    device = indicator("flintec-dad-141", {})
    assert device.differences() == []
    device.twin.settings["filter_level"] = 5.0
    assert device.differences() == ["Flintec DAD 141.1 cell: filter_level is 5, was 3"]


@pytest.mark.parametrize("kind", ["flintec-dad-141", "seneca-z-sg2"])
def test_swapped_words_are_no_load(kind: str) -> None:
    device = indicator(kind)
    device.track(0.1)
    refused = 0
    for number in range(1, 65):
        words = device.contract.pack("net", 0.037 * number)
        value = device.contract.decode("net", words[2:] + words[:2])
        device.twin.read = lambda name, value=value: value if name == "net" else 0.0  # type: ignore[method-assign,misc]
        try:
            shown = device.read().reading_mV
        except DeviceError as error:
            assert "its words come in the other order" in str(error)
            refused += 1
        else:
            refused += bool(device.contract.misread("net", shown / SPAN))  # its driver on a bus refuses these
    assert refused > 48  # of 64 readings, any one of which is enough


def test_a_fault_bit_says_that_there_is_no_load() -> None:
    device = indicator("laumas-tlb4")
    device.track(0.1)
    read = device.twin.read
    device.twin.read = lambda name: 1.0 if name == "status" else read(name)  # type: ignore[method-assign]
    assert device.read().sick == "error of the load cell"
    assert not device.read().valid
    assert device.sick().startswith("error of the load cell; check")


def test_a_bit_may_say_that_all_is_well() -> None:
    device = indicator("flintec-dad-141", faults={"not set_point_0": "no data"})
    device.track(0.1)
    assert (device.read().sick, device.sick()) == ("", "")
    read = device.twin.read
    device.twin.read = lambda name: 0.0 if name == "status" else read(name)  # type: ignore[method-assign]
    assert device.read().sick == "no data"
    assert indicator("seneca-z-sg2", status="", stable="", faults={"not ready": "no data"}).sick() == ""


@pytest.mark.parametrize("window", [None, 1.0])
def test_a_reading_that_is_missing_is_in_no_range(window: float | None) -> None:
    device = indicator("seneca-z-sg2", stable="", faults={})
    device.track(0.1)
    device.twin.rig.load(3.0)
    if window:
        device.peak_to_peak(window)
    asked, read = [], device.twin.read

    def gaps(name: str) -> float:
        if name != device.kind.serves["load_indicator"].reading:  # type: ignore[union-attr]
            return read(name)
        asked.append(name)
        return math.nan if len(asked) == 2 else read(name)  # the second of some readings

    device.twin.read = gaps  # type: ignore[method-assign]
    assert not device.read().valid
    assert len(asked) > 2


@pytest.mark.parametrize("kind", ["flintec-dad-141", "laumas-tlb4"])
def test_a_display_that_stands_still_while_the_load_moves_is_sick(kind: str) -> None:
    device = indicator(kind)
    shaken(device, 2.0)
    assert device.read().valid
    read, stuck = device.twin.read, {name: device.twin.read(name) for name in device.twin.readings}
    device.twin.read = lambda name: stuck.get(name, 0.0) if name in stuck else read(name)  # type: ignore[method-assign]
    assert device.read().sick == "display not updated"


def test_a_reading_behind_another_filter_is_not_stable() -> None:
    device = indicator("flintec-dad-141")
    device.check_frequency(FREQUENCY)
    device.peak_to_peak(0.5)
    assert device.read().stable
    device.twin.reset()
    assert why_invalid(device.read()) == "filter_level has changed"


def test_the_tare_is_taken_off() -> None:
    device = indicator("flintec-dad-141")
    device.track(0.1)
    device.twin.rig.load(2.0)
    device.clock.wait(1.0)
    device.command("tare")
    assert device.read().reading_mV == 0.0
    device.clear_tare()
    assert device.read().reading_mV == pytest.approx(2.0 * SPAN, abs=1.01e-3 * SPAN)


def test_what_is_lost_stays_within_what_is_told() -> None:
    sampled = Following(LowPass(corner=17.0, order=3), 600.0)
    assert sampled.loss(10.0) == pytest.approx(1 - math.cos(math.pi / 60) / math.sqrt(1 + (10 / 17) ** 6))
    assert sampled.highest() == 11.6
    for named in (sampled, Following(LowPass(corner=0.03), 12.5)):
        assert named.loss(named.highest()) <= LARGEST_LOSS < named.loss(1.01 * named.highest())
    polled = Following(LowPass(corner=1e6), 1e6, polled=True)
    assert polled.relative_u(10.0) > polled.loss(10.0)
    for frequency in (0.7, 10.0, 99.0, 126.0):
        times = np.cumsum([0.0, *pauses(max(0.5, 3 / frequency))])
        assert len(times) == POLLS
        swing = np.ptp(np.sin(2 * math.pi * frequency * times)) / 2
        assert 1 - swing < 3 * polled.relative_u(frequency)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"reading": "weight"}, "reading = 'weight' is no field that can be read; valid: gross"),
        ({"clear": "reset"}, "clear = 'reset' is no command; valid: clear_extremes"),
        ({"stable": "steady"}, "'steady' is no bit of status"),
        ({"clear": ""}, "must be cleared by a command"),
        ({"greatest": "peak"}, "give both, or none"),
        ({"peak_to_peak": "converter"}, "they must be in one unit"),
    ],
)
def test_a_role_that_the_map_cannot_serve_is_refused(change: dict[str, str], says: str) -> None:
    kind = device_kind("flintec-dad-141")
    table = kind.serves["load_indicator"].model_copy(update=change)
    assert isinstance(table, LoadIndicatorMap)
    assert says in "; ".join(table.wrong(kind.contract))


@pytest.mark.parametrize(
    "low_pass", [LowPass(corner=17.0, order=3), LowPass(corner=80.0), LowPass(corner=4.0, order=2)]
)
def test_the_filter_of_a_twin_passes_what_a_butterworth_filter_passes(low_pass: LowPass) -> None:
    rate, frequency = 600.0, 10.0
    time = np.arange(1200) / rate
    force = 3.0 + np.sin(2 * math.pi * frequency * time)
    passed = low_passed(force, low_pass, rate)
    assert np.ptp(passed[-600:]) / 2 == pytest.approx(low_pass.passes(frequency), rel=5e-3)
    assert passed[-600:].mean() == pytest.approx(3.0, abs=1e-3)
    early = low_passed(force[:700], low_pass, rate)
    assert early == pytest.approx(passed[:700], abs=1e-9)  # nothing that comes later counts
