"""Load indicators, our own and those of makers: what they show is the load in mV, and what is old or wrong is told."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pyModbusTCP.server import DataBank

from palpate.drivers.devices.device import Device, DevicePlace
from palpate.drivers.devices.load_indicator import (
    LARGEST_LOSS,
    POLLS,
    Following,
    IndicatorReading,
    MappedLoadIndicator,
    StrainIndicator,
    pauses,
)
from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.roles import why_invalid
from palpate.extend import Bench, ModbusDevice, Scene
from palpate.instrument.bench.kinds import device_kind, kind_in_file
from palpate.instrument.bench.links import TcpLink
from palpate.instrument.bench.role_maps import LoadIndicatorMap, LoadIndicatorSettings, LowPass
from palpate.instrument.contracts.field import Value
from palpate.instrument.contracts.own import STRAIN_INDICATOR
from palpate.instrument.errors import DeviceError, RangeError
from palpate.instrument.models.response import response
from palpate.instrument.sensor.sample import SAMPLES, Load
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.load_indicator import SimulatedMappedLoadIndicator, low_passed
from palpate.simulators.rig import IDEAL_SENSITIVITY
from palpate.simulators.wire.device import SimulatedDevice, SimulatedPlace
from palpate.testing import RtuConformance
from tests.drivers.benches import drive
from tests.drivers.fake_links import Registers
from tests.drivers.other_stacks import serving
from tests.shares import first_of

GRAVITY = 9.80665  # m/s2
MILLIVOLT_PER_NEWTON = 10.306  # of Table 5.1


class TestStrainIndicator(RtuConformance):
    @staticmethod
    def ends(bench: Bench, sim: SimulatedBench) -> tuple[ModbusDevice, SimulatedDevice]:
        return bench.device("strain_indicator"), sim.indicator


def test_a_weight_reads_as_in_table_5_1(bench: Bench) -> None:
    for mass, reading in ((0.0, 2), (0.14, 16), (0.44, 46), (0.74, 77)):
        bench.operator.place_weight(mass)
        bench.clock.wait(2.0)
        shown = bench.device("strain_indicator").read()
        assert (shown.reading_mV, shown.resolution_mV, shown.valid) == (pytest.approx(reading, abs=1), 1.0, True)


def ideal(scene: Scene) -> Scene:
    """The scene without its load cell's zero, noise and steps."""
    return replace(scene, effects={})


def test_zero_and_tare_are_taken_acknowledged_and_cleared(bench: Bench) -> None:
    indicator = bench.device("strain_indicator")
    bench.operator.place_weight(0.3)
    bench.clock.wait(2.0)
    gross = indicator.read().reading_mV
    indicator.command("zero")
    assert indicator.read().reading_mV == pytest.approx(0, abs=1)
    assert indicator.contract.choice("last_command", indicator.get("last_command")) == "zero"
    bench.operator.place_weight(0.5)
    bench.clock.wait(2.0)
    indicator.command("tare")
    assert indicator.contract.set_bits("status", indicator.get("status")) == {"stable", "net"}
    assert indicator.read().reading_mV == pytest.approx(0, abs=1)
    indicator.clear_tare()
    assert indicator.contract.set_bits("status", indicator.get("status")) == {"stable"}
    assert indicator.read().reading_mV == pytest.approx(0.2 * GRAVITY * MILLIVOLT_PER_NEWTON, abs=1.5)
    indicator.command("clear_zero")
    assert indicator.read().reading_mV == pytest.approx(gross + 0.2 * GRAVITY * MILLIVOLT_PER_NEWTON, abs=1.5)


def test_a_command_is_pending_until_it_is_carried_out_and_a_second_one_is_given_after_it(
    bench: Bench, sim: SimulatedBench
) -> None:
    indicator = bench.device("strain_indicator")
    bench.clock.wait(2.0)
    indicator.set(command="tare")
    assert indicator.get("command") == 3
    sim.clock.wait(0.049)
    assert indicator.get("command") == 3
    indicator.set(command="zero")  # which it answers with "busy" until the first is carried out
    assert indicator.get_many("command", "last_command", "command_result") == [1, 3, 1]
    sim.clock.wait(0.05)
    assert indicator.get_many("command", "last_command", "command_result") == [0, 1, 1]


def test_zero_and_tare_are_refused_while_the_reading_moves(bench: Bench) -> None:
    for command in ("zero", "tare"):
        bench.operator.place_weight(0.3)
        with pytest.raises(DeviceError, match=f"{command} ended in refused_unstable; wait for a stable"):
            bench.device("strain_indicator").command(command)
        bench.operator.place_weight(0.0)
        bench.device("strain_indicator").command("clear_zero")
        bench.device("strain_indicator").clear_tare()
    assert bench.device("strain_indicator").get("status") == 0


def test_a_command_is_carried_out_when_it_is_due_whether_anybody_looks_or_not(scene: Scene) -> None:
    with SimulatedBench(ideal(scene)) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        bench.device("strain_indicator").track(1.0)
        sim.clock.wait(10.0)
        bench.operator.place_weight(0.3)
        sim.clock.wait(7.0)
        bench.device("strain_indicator").set(command="tare")
        sim.clock.wait(0.95)
        final = 0.3 * GRAVITY * MILLIVOLT_PER_NEWTON
        missed = final * (math.exp(-7.05) - math.exp(-7.95))  # what the filter gained since the tare
        assert bench.device("strain_indicator").read().reading_mV == pytest.approx(missed, abs=1e-4)
        bench.operator.place_weight(0.5)
        sim.clock.wait(10.0)
        net = 0.2 * GRAVITY * MILLIVOLT_PER_NEWTON + final * math.exp(-7.05)
        assert bench.device("strain_indicator").read().reading_mV == pytest.approx(net, abs=2e-3)


@pytest.mark.parametrize("name", ["1", "6"])
def test_the_peak_to_peak_of_a_known_load(name: str, scene: Scene) -> None:
    with SimulatedBench(ideal(scene)) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        bench.operator.mount(SAMPLES[name])
        bench.device("positioner").move(20e-3, speed=5e-3)
        bench.device("shaker_amplifier").configure(gain=2.0, current_limit=5.0, watchdog=2.0)
        bench.device("strain_indicator").peak_to_peak(1.0)
        drive(bench, 1.5)
        bench.clock.wait(0.999)
        assert not bench.device("strain_indicator").read().stable
        bench.clock.wait(0.002)
        shown = bench.device("strain_indicator").read()
        stack = response(scene.design, Load(1.0, SAMPLES[name]), scene.model).stiffness
        rig = scene.rig
    force = 2 * 1.5 * 2.0 / rig.coil_resistance * rig.force_constant * stack / (stack + rig.suspension_stiffness)
    assert shown.stable
    assert shown.reading_mV == pytest.approx(force * MILLIVOLT_PER_NEWTON, rel=1e-4)


def test_peak_to_peak_sees_only_its_window(bench: Bench) -> None:
    bench.device("strain_indicator").peak_to_peak(1.0)
    bench.operator.place_weight(0.5)
    bench.clock.wait(0.5)
    assert bench.device("strain_indicator").read().reading_mV > 40
    bench.clock.wait(0.6)
    assert bench.device("strain_indicator").read().reading_mV < 4


# --- the driver by itself ------------------------------------------------------------------------------


STABLE, OVERLOAD, OPEN = (1 << STRAIN_INDICATOR["status"].bits[bit] for bit in ("stable", "overload", "bridge_open"))


def indicator(**held: Any) -> tuple[StrainIndicator, Any, VirtualClock]:
    link: Any = Registers(STRAIN_INDICATOR, status=STABLE, **held)
    clock = VirtualClock()
    return StrainIndicator.at(DevicePlace(link, 1, None, clock)), link, clock


def shows(link: Any, counts: int, decimals: int = 1) -> None:
    link.put(reading=counts, decimals=decimals, reading_float=counts * 10.0**-decimals)


# --- one reading ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("counts", "decimals", "reading", "step"), [(123, 1, 12.3, 0.1), (-45, 0, -45.0, 1.0)])
def test_the_display_is_read_with_the_place_of_its_point(
    counts: int, decimals: int, reading: float, step: float
) -> None:
    driver, link, _ = indicator()
    assert math.isnan(driver.resolution_mV)
    shows(link, counts, decimals)
    assert driver.read() == IndicatorReading(pytest.approx(reading), step, "", "")  # type: ignore[arg-type]
    assert driver.resolution_mV == step


@pytest.mark.parametrize(
    ("status", "valid", "sick"),
    [
        (STABLE, True, ""),
        (0, False, ""),  # only moving
        (STABLE | OVERLOAD, False, "overload"),
        (OPEN, False, "bridge open"),
        (STABLE | OPEN | OVERLOAD, False, "bridge open, overload"),
    ],
)
def test_a_reading_is_valid_where_it_stands_still_and_the_bridge_is_whole(status: int, valid: bool, sick: str) -> None:
    driver, link, _ = indicator()
    if status & OPEN:  # it reads nothing then, whatever its two readings say
        link.put(reading=100, reading_float=math.nan)
    link.put(status=status)
    reading = driver.read()
    assert (reading.valid, reading.sick, math.isnan(reading.reading_mV)) == (valid, sick, bool(status & OPEN))
    assert driver.sick() == (sick and f"{sick}; check the bridge and its wires")


@pytest.mark.parametrize(
    ("counts", "floating", "used"),
    [
        (100, 10.1, True),  # within a step: the display rounds
        (100, 9.9, True),
        (100, 10.11, False),
        (100, 9.89, False),
        (-100, -10.11, False),
        (-100, 10.0, False),
        (100, math.nan, False),
        (2_000_000, 200_000.25, True),  # the float has 24 bits
        (2_000_000, 200_000.5, False),
    ],
)
def test_the_integer_and_the_float_agree_within_a_step_and_the_precision_of_a_float(
    counts: int, floating: float, used: bool
) -> None:
    driver, link, _ = indicator()
    link.put(reading=counts, decimals=1, reading_float=floating)
    if used:
        assert driver.read().reading_mV == pytest.approx(counts / 10)
        return
    with pytest.raises(
        DeviceError, match=rf"reading is {counts / 10:g} mV as an integer and .* as a float, so it is not used"
    ):
        driver.read()


# --- displays that are not renewed -----------------------------------------------------------------------


@pytest.mark.parametrize(("seconds", "stale"), [(0.3, False), (0.301, True), (100.0, True)])
def test_a_display_is_stale_when_it_was_not_renewed_though_there_was_time_for_three(
    seconds: float, stale: bool
) -> None:
    driver, link, clock = indicator(updates=7)
    assert not driver.read().sick
    clock.wait(seconds)
    reading = driver.read()
    assert reading.sick == ("display not updated" if stale else "")
    link.put(updates=8)
    assert not driver.read().sick


def test_a_reading_with_the_count_of_the_one_before_is_asked_for_once_more() -> None:
    """It may be the reply of then, which was late; on a serial line the second one has another length."""
    driver, link, _ = indicator(updates=7)
    driver.read()
    assert len(link.asked) == 1
    driver.read()
    assert len(link.asked) == 3
    link.put(updates=8)
    driver.read()
    assert len(link.asked) == 4


@pytest.mark.parametrize(
    ("before", "now", "seconds", "used"),
    [
        (100, 101, 1.0, True),
        (100, 100 + 32768, 1.0, True),  # half the numbers that the counter has
        (100, 100 + 32769, 1.0, False),
        (100, 99, 1.0, False),
        (65535, 0, 1.0, True),  # it starts over
        (0, 65535, 1.0, False),
        (100, 99, 999.9, False),
        (100, 99, 1000.0, True),  # so long that it may have come round
    ],
)
def test_a_display_that_was_renewed_less_often_than_before_is_an_old_reply(
    before: int, now: int, seconds: float, used: bool
) -> None:
    driver, link, clock = indicator(updates=before)
    driver.read()
    clock.wait(seconds)
    link.put(updates=now)
    if used:
        assert not driver.read().sick
        assert link.distrusted == 0
        return
    with pytest.raises(
        DeviceError, match=f"updated {now} times, but {before} times at the reading before; the reply is late"
    ):
        driver.read()
    assert link.distrusted == 1  # the true reply may still come


# --- settings and commands -----------------------------------------------------------------------------


COMMANDS = STRAIN_INDICATOR["command"].choices
RESULTS = STRAIN_INDICATOR["command_result"].choices


def carried_out(link: Any, clock: VirtualClock, after: float, last: str, result: str) -> None:
    """The command is done `after` s."""
    begun = clock.now_ns()

    def look(reply: Any) -> Any:
        if getattr(reply, "registers", None) and 1e-9 * (clock.now_ns() - begun) >= after:
            link.put(command="idle", last_command=COMMANDS[last], command_result=RESULTS[result])
        return reply

    link.replied = look


@pytest.mark.parametrize(
    ("last", "result", "ended"), [("zero", "refused_unstable", "refused_unstable"), ("tare", "done", "done")]
)
def test_a_command_that_was_refused_or_was_another_one_is_told(last: str, result: str, ended: str) -> None:
    driver, link, clock = indicator()
    carried_out(link, clock, 0.0, last, result)
    with pytest.raises(DeviceError, match=f"^strain indicator at .*: zero ended in {ended}; wait for a stable reading"):
        driver.command("zero")


def test_a_command_is_not_waited_for_longer_than_a_second() -> None:
    driver, _, clock = indicator()
    begun = clock.now_ns()
    with pytest.raises(DeviceError, match=r"tare was not carried out within 1 s; repeat it, or restart the indicator$"):
        driver.command("tare")
    assert clock.now_ns() - begun == pytest.approx(1e9)


# --- words in the other order --------------------------------------------------------------------------


NET, STATUS = 10, 20
MAP = """
[device]
name = "scale"
title = "Scale"
bus = "modbus"
links = ["modbus-tcp"]
vendor = "Nobody"
known_by = "nothing"
[field.net]
address = 10
type = "{type}"
meaning = "net load"
unit = "N"
{more}
[field.status]
address = 20
type = "uint16"
meaning = "status"
bits = {{ stable = 0 }}
[role.load_indicator]
reading = "net"
status = "status"
stable = "stable"
rate = 100.0
"""
FORMATS = {"float32": "f", "int32": "i", "float64": "d"}
LOADS = (1.234, -3.21, 100.37, -0.017)


class Scale:
    """A scale that shows loads in newtons, on a server of pyModbusTCP, and the driver of a map for it."""

    def __init__(
        self,
        stack: ExitStack,
        server: tuple[int, DataBank],
        folder: Path,
        type_: str,
        more: str = "",
        swapped: bool = False,
    ) -> None:
        (port, self._bank), self._type, self._swapped = server, type_, swapped
        file = folder / f"{type_}.toml"
        file.write_text(MAP.format(type=type_, more=more), encoding="utf-8")
        link = ModbusLink.tcp(TcpLink(host="127.0.0.1", port=port, timeout="5 s"))  # type: ignore[arg-type]
        link.open()
        stack.callback(link.close)
        settings = LoadIndicatorSettings(span=10.0, resolution=0.001, bandwidth="40 Hz")  # type: ignore[arg-type]
        self.driver: Any = MappedLoadIndicator.at(
            DevicePlace(link, 1, settings, VirtualClock(), kind_in_file(file), "LAB-1")
        )
        self.noticed: list[str] = []
        self.driver.noticed = self.noticed.append
        self.driver.set_up(settings, 2.0)
        self.driver.track(0.01)
        self._bank.set_holding_registers(STATUS, [1])

    def show(self, load: float) -> None:
        value = load if self._type.startswith("float") else round(1e3 * load)
        self.hold(struct.pack(f">{FORMATS[self._type]}", value))

    def hold(self, data: bytes) -> None:
        words = list(struct.unpack(f">{len(data) // 2}H", data))
        self._bank.set_holding_registers(NET, words[::-1] if self._swapped else words)

    def read(self, load: float) -> IndicatorReading:
        self.show(load)
        found: IndicatorReading = self.driver.read()
        return found


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[int, DataBank]]:
    """The port of a server of pyModbusTCP, and what it holds."""
    bank = DataBank()
    with serving(bank) as port:
        yield port, bank


@pytest.fixture
def scale(server: tuple[int, DataBank], tmp_path: Path) -> Iterator[Callable[..., Scale]]:
    with ExitStack() as stack:
        yield partial(Scale, stack, server, tmp_path)


@pytest.mark.parametrize(("type_", "more"), [("float32", ""), ("int32", "scale = 0.001"), ("float64", "")])
@pytest.mark.parametrize("load", first_of(LOADS))
def test_a_reading_with_swapped_words_is_refused_or_in_doubt(
    type_: str, more: str, load: float, scale: Callable[..., Scale]
) -> None:
    shown = scale(type_, more, swapped=True)
    try:
        found = shown.read(load)
    except DeviceError as error:
        assert f"its words come in the other order ({load:g} N)" in str(error)
    else:
        assert f"in the other order {load:g} N: which is right is not told yet" in found.doubt


def test_a_doubt_is_one_incident_until_it_is_told_what_to_read_and_ends_with_a_reading_that_tells(
    scale: Callable[..., Scale],
) -> None:
    shown = scale("float32")
    assert (shown.read(0.0).doubt, shown.noticed) == ("", [])  # the same in both orders
    doubtful = struct.unpack(">f", bytes.fromhex("BD71 42C8"))[0]  # 100.37 with its words swapped
    assert all(shown.read(doubtful).doubt for _ in range(2))
    assert len(shown.noticed) == 1
    assert "compare with the display, or change the load until a reading tells" in shown.noticed[0]
    shown.driver.track(0.01)
    assert shown.read(doubtful).doubt
    assert len(shown.noticed) == 2
    found = shown.read(2.5)
    assert (found.valid, found.reading_mV, found.doubt) == (True, 25.0, "")
    assert (shown.read(doubtful).doubt, len(shown.noticed)) == ("", 2)


@pytest.mark.slow
def test_readings_that_differ_decide_soon(scale: Callable[..., Scale]) -> None:
    for type_, more in (("float32", ""), ("int32", "scale = 0.001")):
        right = scale(type_, more)
        doubts = [right.read(load).doubt for load in LOADS]
        assert not any(doubts[1:])
        swapped = scale(type_, more, swapped=True)
        with pytest.raises(DeviceError, match="its words come in the other order"):
            for load in LOADS:
                swapped.read(load)


def test_what_is_no_load_in_either_order_is_refused_with_what_to_look_at(scale: Callable[..., Scale]) -> None:
    shown = scale("float32")
    for data in ("7F7F FFFF", "7CF0 0000", "FF7F FFFF", "5000 0000"):
        shown.hold(bytes.fromhex(data))
        with pytest.raises(DeviceError, match=r"N, which is no load; check type, address and scale .* as `missing`"):
            shown.driver.read()


@pytest.mark.parametrize("missing", ["0x7F7FFFFF", "3.4028234663852886e38"])
def test_a_value_that_says_that_there_is_no_reading_is_none(missing: str, scale: Callable[..., Scale]) -> None:
    shown = scale("float32", f"missing = [{missing}]")
    shown.hold(bytes.fromhex("7F7F FFFF"))
    assert not shown.driver.read().valid


# --- load indicators of makers -------------------------------------------------------------------------


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


def mapped(kind: str, section: dict[str, Any] | None = None, set_up: bool = True, **role: Any) -> Straight:
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
    device = mapped(kind)
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
    device = mapped(kind)
    shaken(device, 4.0)
    found = device.read()
    assert found.valid
    assert found.difference
    assert 0 < found.u_mV < 0.05 * found.reading_mV
    assert abs(found.reading_mV - 4.0 * SPAN) <= 2 * found.u_mV + device.resolution_mV


@pytest.mark.parametrize(
    ("kind", "role", "says"),
    [
        ("flintec-dad-141", {}, "."),
        ("flintec-dad-141", {"stable": "not tare_set"}, "."),
        ("seneca-z-sg2", {"stable": ""}, r"3 readings differ by 0\.\d+ N, one step is 0\.001 N; .* write a resolution"),
    ],
)
def test_a_load_that_moves_is_not_stable_with_a_bit_for_it_or_without(
    kind: str, role: dict[str, str], says: str
) -> None:
    device = mapped(kind, **role)
    device.track(0.013)
    device.twin.rig.load(3.0, 1.0)
    device.clock.wait(1.0)
    assert re.match(says, why_invalid(device.read()))
    device.twin.rig.load(3.0)
    device.clock.wait(1.0)
    assert why_invalid(device.read()) == ""


@pytest.mark.parametrize("role", [{}, {"peak_to_peak": "", "greatest": "peak", "least": "valley"}])
def test_extremes_are_those_since_the_last_reading_began_told_as_two_or_as_their_difference(
    role: dict[str, str],
) -> None:
    device = mapped("flintec-dad-141", **role)
    for swing in (4.0, 1.0):
        shaken(device, swing)
        assert device.read().reading_mV == pytest.approx(swing * SPAN, rel=0.03)


def test_the_filter_of_the_factory_cuts_the_force_and_is_refused_by_name_with_what_helps() -> None:
    device = mapped("flintec-dad-141", {})
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
        mapped(kind, section)


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
        mapped(kind, section).check_frequency(frequency)


def test_a_display_whose_step_changes_stops_by_name() -> None:
    for kind, field, value in (("flintec-dad-141", "display_step", 0.002), ("laumas-tlb4", "division", 12.0)):
        device = mapped(kind)
        device.twin.settings[field] = value
        with pytest.raises(DeviceError, match=f"{field} says .* before, so the display has changed"):
            device.differences()


def test_a_filter_that_somebody_changes_is_told() -> None:
    device = mapped("flintec-dad-141", {})
    assert device.differences() == []
    device.twin.settings["filter_level"] = 5.0
    assert device.differences() == ["Flintec DAD 141.1 cell: filter_level is 5, was 3"]


@pytest.mark.parametrize(
    ("kind", "role", "status", "sick"),
    [
        ("laumas-tlb4", {}, 1.0, "error of the load cell"),
        ("flintec-dad-141", {"faults": {"not set_point_0": "no data"}}, 0.0, "no data"),  # all is well where it is set
    ],
)
def test_a_fault_bit_says_that_there_is_no_load(kind: str, role: dict[str, Any], status: float, sick: str) -> None:
    device = mapped(kind, **role)
    device.track(0.1)
    assert (device.read().sick, device.sick()) == ("", "")
    read = device.twin.read
    device.twin.read = lambda name: status if name == "status" else read(name)  # type: ignore[method-assign]
    assert (device.read().sick, device.read().valid) == (sick, False)
    assert device.sick().startswith(f"{sick}; check")
    assert mapped("seneca-z-sg2", status="", stable="", faults={"not ready": "no data"}).sick() == ""


@pytest.mark.parametrize("window", [None, 1.0])
def test_a_reading_that_is_missing_is_in_no_range(window: float | None) -> None:
    device = mapped("seneca-z-sg2", stable="", faults={})
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
    device = mapped(kind)
    shaken(device, 2.0)
    assert device.read().valid
    read, stuck = device.twin.read, {name: device.twin.read(name) for name in device.twin.readings}
    device.twin.read = lambda name: stuck.get(name, 0.0) if name in stuck else read(name)  # type: ignore[method-assign]
    assert device.read().sick == "display not updated"


def test_a_reading_behind_another_filter_is_not_stable() -> None:
    device = mapped("flintec-dad-141")
    device.check_frequency(FREQUENCY)
    device.peak_to_peak(0.5)
    assert device.read().stable
    device.twin.reset()
    assert why_invalid(device.read()) == "filter_level has changed"


def test_the_tare_is_taken_off() -> None:
    device = mapped("flintec-dad-141")
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
