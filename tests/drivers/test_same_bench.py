"""A run goes on where the bench is the same, however its file is written; what has changed is told by name."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import tomli_w

from palpate.instrument.bench.description import BenchDescription, compared, recorded_bench
from palpate.procedures.records.resumed import COMPARED, comparable, differences
from tests.drivers.benches import new_form
from tests.drivers.outside import installed

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


def amplifier(tables: dict[str, Any]) -> None:
    tables["device"]["shaker_amplifier"]["current_limit"] = "5 A"


def limit(tables: dict[str, Any]) -> None:
    tables["force_limit"] = "9 N"


def moved(tables: dict[str, Any]) -> None:
    tables["device"]["positioner"]["unit"] = 9


def elsewhere(tables: dict[str, Any]) -> None:
    tables["link"]["my_can"]["channel"] = "can1"


def other_line(tables: dict[str, Any]) -> None:
    tables["link"]["second"] = {"kind": "modbus-rtu", "port": "/dev/ttyUSB1"}
    tables["device"]["positioner"]["link"] = "second"


def role(tables: dict[str, Any]) -> None:
    tables["device"]["left"]["role"] = tables["device"]["right"].pop("role")


CHANGES: list[tuple[Callable[[dict[str, Any]], None], list[str]]] = [
    (limit, ['bench.force_limit: "8.0 N" in the record, "9.0 N" now']),
    (amplifier, ['bench.device.shaker_amplifier.current_limit: "4.0 A" in the record, "5.0 A" now']),
    (moved, ["bench.device.positioner.unit: 2 in the record, 9 now"]),
    (
        other_line,
        ["bench.link.second: null in", 'bench.device.positioner.link: "line" in the record, "sec'],
    ),
    (elsewhere, ['bench.link.can.channel: "can0" in the record, "can1" now']),
    (
        role,
        ['bench.device.left.role: "" in the record, "chamber" now', 'bench.device.right.role: "chamber" in'],
    ),
]


@pytest.mark.parametrize(("change", "expected"), CHANGES)
def test_each_change_is_told_by_the_name_of_link_device_and_setting(
    change: Callable[[dict[str, Any]], None], expected: list[str]
) -> None:
    old = tomllib.loads(OLD + OVENS)
    now = new_form(bench(old))
    now["device"]["right"]["role"] = "chamber"
    change(now)
    said = told(old, now)
    for text, start in zip(said, expected, strict=True):
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
