"""A run goes on where the bench is the same, however its file is written; what its file cannot say is told by name."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Iterator
from functools import reduce
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from palpate.drivers.bench import Bench
from palpate.drivers.clock import WallClock
from palpate.instrument.bench.description import BenchDescription, compared, read_bench, recorded_bench
from palpate.instrument.errors import BenchError, ConfigError, LinkError
from palpate.procedures.lab import operator as console
from palpate.procedures.records.resumed import COMPARED, comparable, differences
from tests.drivers.benches import installed, new_form

OLD = """
name = "bench"
force_limit = "8 N"
[signal_generator]
host = "10.0.0.1"
[shaker_amplifier]
host = "10.0.0.1"
unit = 2
current_limit = "4 A"
[line]
port = "/dev/ttyUSB0"
[can]
interface = "socketcan"
channel = "can0"
nodes = [1, 2]
"""
OVENS = """
[link.rack]
kind = "modbus-tcp"
host = "10.0.0.3"
[device.left]
kind = "acme-oven"
link = "rack"
unit = 1
[device.right]
kind = "acme-oven"
link = "rack"
unit = 2
role = "chamber"
"""


@pytest.fixture(autouse=True)
def oven() -> Iterator[None]:
    with installed("oven"):
        yield


def bench(tables: dict[str, Any]) -> BenchDescription:
    """The bench of a record, in the older form or in the present one."""
    return recorded_bench(tomli_w.dumps(tables), "a record")


def told(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    return list(differences(*compared(bench(before), bench(now)), "bench"))


def test_an_old_file_and_its_new_form_describe_the_same_bench() -> None:
    old = tomllib.loads(OLD)
    assert told(old, new_form(bench(old))) == told(new_form(bench(old)), old) == []
    assert len(new_form(bench(old))["link"]) == 3  # both units of the gateway are on one link


def test_a_device_under_another_name_is_the_same_and_a_role_that_need_not_be_said_changes_nothing() -> None:
    old = tomllib.loads(OLD + OVENS)
    renamed = copy.deepcopy(old)
    renamed["device"]["near"] = renamed["device"].pop("left")
    del old["device"]["left"], renamed["device"]["near"], renamed["device"]["right"]["role"]
    assert told(old, renamed) == []


def test_the_order_of_sensor_nodes_counts_because_it_says_which_film_is_on_which_node() -> None:
    one = new_form(bench(tomllib.loads(OLD)))
    other = copy.deepcopy(one)
    first, second = other["device"].pop("sensor_node_1"), other["device"].pop("sensor_node_2")
    other["device"] |= {"sensor_node_2": second, "sensor_node_1": first}
    assert told(one, other) == [
        'bench.device.sensor_node_1.role: "sensor_node 1" in the record, "sensor_node 2" now',
        'bench.device.sensor_node_2.role: "sensor_node 2" in the record, "sensor_node 1" now',
    ]


SECOND = {"kind": "modbus-rtu", "port": "/dev/ttyUSB1"}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"force_limit": "9 N"}, ['bench.force_limit: "8.0 N" in the record, "9.0 N" now']),
        (
            {"device.shaker_amplifier.current_limit": "5 A"},
            ['bench.device.shaker_amplifier.current_limit: "4.0 A" in the record, "5.0 A" now'],
        ),
        ({"device.positioner.unit": 9}, ["bench.device.positioner.unit: 2 in the record, 9 now"]),
        (
            {"link.second": SECOND, "device.positioner.link": "second"},
            ["bench.link.second: null in", 'bench.device.positioner.link: "line" in the record, "sec'],
        ),
        ({"link.my_can.channel": "can1"}, ['bench.link.can.channel: "can0" in the record, "can1" now']),
        (
            {"device.left.role": "chamber", "device.right": {"kind": "acme-oven", "link": "my_rack", "unit": 2}},
            ['bench.device.left.role: "" in the record, "chamber" now', 'bench.device.right.role: "chamber" in'],
        ),
    ],
)
def test_each_change_is_told_by_the_name_of_link_device_and_setting(
    changes: dict[str, Any], expected: list[str]
) -> None:
    old = tomllib.loads(OLD + OVENS)
    now = new_form(bench(old))
    now["device"]["right"]["role"] = "chamber"
    for path, value in changes.items():
        *tables, key = path.split(".")
        reduce(dict.__getitem__, tables, now)[key] = value
    for text, start in zip(told(old, now), expected, strict=True):
        assert text.startswith(start)


def test_serial_numbers_of_two_devices_of_one_kind_are_both_compared() -> None:
    header = {
        "settings": {}, "scene": None, "bench": OLD, "contracts": "", "calibration": {}, "film_calibration": None,
        "versions": {}, "devices": {"oven at 10.0.0.3:502 unit 1": "A", "oven at 10.0.0.3:502 unit 2": "B"},
    }  # fmt: skip
    swapped = {**header, "devices": {"oven at 10.0.0.3:502 unit 1": "C", "oven at 10.0.0.3:502 unit 2": "B"}}
    assert list(differences(comparable(header), comparable(swapped))) == ['devices.oven: "A" in the record, "C" now']


def test_devices_of_one_kind_on_a_simulated_bench_may_have_any_ports() -> None:
    rest: dict[str, object] = {**dict.fromkeys(COMPARED), "scene": {"toml": ""}, "bench": ""}
    before = {**rest, "devices": {"oven at 127.0.0.1:1": "A", "oven at 127.0.0.1:2": "B"}}
    now = {**rest, "devices": {"oven at 127.0.0.1:1": "B", "oven at 127.0.0.1:2": "A"}}
    assert comparable(before) == comparable(now)


def test_a_changed_map_of_a_makers_device_is_told_by_its_kind() -> None:
    header = {
        "settings": {}, "scene": None, "bench": OLD, "contracts": "", "calibration": {}, "film_calibration": None,
        "versions": {}, "devices": {}, "maps": {"scale": "1" * 64},
    }  # fmt: skip
    (said,) = differences(comparable(header), comparable({**header, "maps": {"scale": "2" * 64}}))
    assert said.startswith('maps.scale: "1111')
    without = {key: value for key, value in header.items() if key != "maps"}
    assert comparable(without)["maps"] == {}


# --- devices that tell nothing -------------------------------------------------------------------------


MAP = """
[device]
name = "{name}"
title = "analogue output"
bus = "modbus"
vendor = "Nobody"
product = "{name}"
revision = "1"
links = ["modbus-rtu", "modbus-tcp"]
known_by = "{known_by}"

[line]
baudrate = {baudrate}
parity = "{parity}"
{more}

[field.output]
address = 0
type = "uint16"
meaning = "output"
access = "rw"
source = "[1] wiki"
"""
MARK = '[[mark]]\nfield = "output"\nvalue = 3\n'


def written(folder: Path, *maps: dict[str, Any], link: str = "", **keys: dict[str, str]) -> BenchDescription:
    """A written of devices that the maps describe, on one link; `keys`: more of the section of a device."""
    text = f'name = "lab"\n[link.rack]\n{link or RACK}\n'
    for unit, given in enumerate(maps, 3):
        name = given.get("name", "output-8")
        said = {"name": name, "known_by": "nothing", "baudrate": 9600, "parity": "N", "more": "", **given}
        (folder / f"{name}.toml").write_text(MAP.format_map(said), encoding="utf-8")
        section = {"map": f'"{name}.toml"', "link": '"rack"', "unit": str(unit)} | keys.get(f"device_{unit}", {})
        text += f"[device.device_{unit}]\n" + "".join(f"{key} = {value}\n" for key, value in section.items())
    (folder / "written.toml").write_text(text, encoding="utf-8")
    return read_bench(folder / "written.toml")


RACK = 'kind = "modbus-rtu"\nport = "/dev/nowhere"'
TCP = 'kind = "modbus-tcp"\nhost = "127.0.0.1"\nport = 1'
KNOWN = {"known_by": "marks", "more": MARK}
SERIAL = '[field.serial]\naddress = 9\ntype = "uint16"\nmeaning = "serial number"\nsource = "[1] wiki"\n'
LABELLED = {"device_3": {"inventory": '"LAB-12"'}}


@pytest.mark.parametrize(
    ("given", "keys", "message"),
    [
        ({}, {}, 'a output-8 tells nothing by which it is known; write inventory = "LABEL"'),
        ({}, {"device_3": {"inventory": '" "'}}, "tells nothing by which it is known"),
        (KNOWN | {"more": SERIAL + MARK}, LABELLED, "a output-8 tells its serial number; leave inventory out"),
        (KNOWN, {"device_3": {"confirmed": "true"}}, "is known by what it tells; leave confirmed out"),
        (KNOWN, {"device_3": {"unit": "0"}}, "unit = 0: a output-8 answers at 1 to 247 alone"),
        (KNOWN | {"more": MARK + "[manners]\nunits = [0, 0]"}, {}, "unit = 3: a output-8 answers at 0 to 0 alone"),
    ],
)
def test_a_section_that_does_not_suit_its_device_is_refused(
    given: dict[str, Any], keys: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=message):
        written(tmp_path, given, **keys)


def test_a_known_device_that_tells_no_serial_number_can_have_a_label_instead(tmp_path: Path) -> None:
    (found,) = written(tmp_path, KNOWN, **LABELLED).devices
    assert (found.inventory, found.unknowable) == ("LAB-12", False)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"parity": "E"}, "device_3 has parity = 'N' and device_4 has parity = 'E' as they leave the factory"),
        ({"baudrate": 19200}, "device_3 has baudrate = 9600 and device_4 has baudrate = 19200"),
    ],
)
def test_devices_that_one_line_cannot_suit_are_refused_until_one_was_set_to_it(
    other: dict[str, Any], message: str, tmp_path: Path
) -> None:
    maps = KNOWN, {"name": "output-9", **KNOWN, **other}
    with pytest.raises(ConfigError, match=message):
        written(tmp_path, *maps)
    assert len(written(tmp_path, *maps, device_4={"set_to_link": "true"}).devices) == 2


class Person:
    """Confirms what it is told to, and remembers it."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, str]] = []

    def confirm_device(self, what: str, label: str) -> None:
        self.asked.append((what, label))

    def __getattr__(self, name: str) -> Any:
        return None


@pytest.mark.parametrize("confirmed", ["true", "false"])
def test_a_person_confirms_a_device_that_tells_nothing_once_before_anything_is_sent(
    confirmed: str, tmp_path: Path
) -> None:
    person: Any = Person()
    described = written(tmp_path, {}, link=TCP, device_3={"inventory": '"LAB-12"', "confirmed": confirmed})
    with pytest.raises(LinkError), Bench(described, WallClock(), person):
        pass  # nothing answers there
    asked = ("device_3 (analogue output, 3 on rack)", "LAB-12")
    assert person.asked == ([] if confirmed == "true" else [asked])


def test_a_console_without_a_terminal_names_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "at_terminal", lambda: False)
    with pytest.raises(BenchError, match="look at its label, then write confirmed = true in its section"):
        console.ConsoleOperator().confirm_device("output", "LAB-12")
    said = list[str]()
    console.ConsoleOperator(lambda what, _word: said.append(what)).confirm_device("output", "LAB-12")
    assert said == ["Look that output is the device labelled LAB-12"]
