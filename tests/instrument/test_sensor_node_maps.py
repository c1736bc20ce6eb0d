"""A map makes a CANopen node a sensor node: what it must say for that, and what of an EDS is enough."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from palpate.instrument.bench.kinds import device_kind, kind_of
from palpate.instrument.bench.role_maps import BiasMap, ExciterMap, raw_limits
from palpate.instrument.config import check
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.maps.eds import imported
from palpate.instrument.contracts.maps.map_file import SHIPPED, map_of
from palpate.instrument.errors import ConfigError

IO = (SHIPPED / "canopennode-io.toml").read_text(encoding="utf-8")
CHANNELS = 'channels = ["analog_1", "analog_2", "analog_3", "analog_4"]'


def test_shipped_nodes_tell_their_channels_their_limits_and_what_they_are_known_by() -> None:
    io, strain, fine = (device_kind(name) for name in ("canopennode-io", "baumer-dsrt", "baumer-dsrt-24"))
    assert [kind.channels for kind in (io, strain, fine)] == [4, 1, 1]
    assert {kind.contract.known_by for kind in (io, strain, fine)} == {"marks"}
    assert raw_limits(io.contract["analog_1"], 1.0) == (-32767, 32767)
    assert raw_limits(strain.contract["strain"], 0.01) == (-32767, 32767)
    assert raw_limits(fine.contract["strain"], 0.01) == (-8388607, 8388607)


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        (
            CHANNELS,
            'channels = ["analog_1", "heartbeat"]',
            "channels: 'heartbeat' is no integer that a PDO sends; valid: ",
        ),
        (
            CHANNELS,
            'channels = ["analog_1", "analog_1"]',
            "channels: analog_1 would come twice at each SYNC; name each",
        ),
        (CHANNELS, "channels = []", "channels: "),
        ("transmission = 1\n", "transmission = 255\n", "channels: PDO samples has transmission = 255; give 1, so that"),
        ('meaning = "analogue input 1"', 'unit = "V"\nmeaning = "x"', "channels: they have several units; a node has"),
        (
            'address = "1006:0"',
            'address = "1007:0"',
            "sends_sync: needs fields at 1005:0 and 1006:0 that can be written",
        ),
        ("fastest = 1000.0", 'status = "error_register"', "status: 'error_register' is no field with a choice `ok`"),
        ("fastest = 1000.0", "fastest = 0.0", "fastest: "),
        ("fastest = 1000.0", "slowest = 1.0", "slowest: unknown key"),
    ],
)
def test_a_table_that_makes_no_sensor_node_is_refused_by_name(old: str, new: str, wrong: str) -> None:
    assert IO.count(old) == 1
    text = IO.replace(old, new).partition("[[frame]]")[0]
    with pytest.raises(ConfigError, match=r"role\.sensor_node") as told:
        kind_of(map_of(Path("io.toml"), text.encode()))
    assert wrong in str(told.value)


SHEET = """[FileInfo]
[DeviceInfo]
VendorName=Maker
ProductName=Inputs
[1000]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=ro
DefaultValue=0x191
[1005]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=rw
DefaultValue=0x80
[1006]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=rw
[1800]
ParameterName=x
ObjectType=0x9
[1800sub1]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=rw
DefaultValue=$NODEID+0x180
[1800sub2]
ParameterName=x
ObjectType=0x7
DataType=0x5
AccessType=rw
DefaultValue=1
[1A00]
ParameterName=x
ObjectType=0x9
[1A00sub0]
ParameterName=x
ObjectType=0x7
DataType=0x5
AccessType=rw
DefaultValue=2
[1A00sub1]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=rw
DefaultValue=0x64010110
[1A00sub2]
ParameterName=x
ObjectType=0x7
DataType=0x7
AccessType=rw
DefaultValue=0x64010210
[6401]
ParameterName=x
ObjectType=0x8
[6401sub1]
ParameterName=x
ObjectType=0x7
DataType=0x3
AccessType=ro
PDOMapping=1
[6401sub2]
ParameterName=x
ObjectType=0x7
DataType=0x3
AccessType=ro
PDOMapping=1
"""


def test_a_data_sheet_and_three_lines_make_a_sensor_node(tmp_path: Path) -> None:
    sheet = tmp_path / "inputs.eds"
    sheet.write_text(SHEET, encoding="ascii")
    text = imported(sheet, ["6401:1=left", "6401:2=right", "1005", "1006"])
    text += '\n[role.sensor_node]\nchannels = ["left", "right"]\nsends_sync = true\n'
    kind = kind_of(map_of(tmp_path / "inputs.toml", text.encode()))
    assert (kind.channels, kind.roles, kind.contract.pdos[0].fields) == (2, ("sensor_node",), ("left", "right"))


# --- Tables `[role.exciter]` and `[role.bias]` that name what a map does not have are refused, each thing by its key


def wrong(kind: str, role: str, contract: Contract | None = None, **changes: Any) -> list[str]:
    found = device_kind(kind)
    assert found.map is not None
    model: type[ExciterMap | BiasMap] = ExciterMap if role == "exciter" else BiasMap
    return check({**found.map.roles[role], **changes}, model, "role").wrong(contract or found.contract)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"stream": "torque"}, "stream = 'torque' is no process data it takes; valid: set_point"),
        ({"enable": "run"}, "enable = 'run' is no command; valid: shutdown, switch_on, enable, disable, reset"),
        (
            {"fault": ("statusword", "broken")},
            "fault = ['statusword', 'broken'] is no bit of a field; valid bits of it",
        ),
        ({"error": "number"}, "error: 'number' is no field; valid: device_type,"),
        ({"set_up": {"gear": 1}}, "set_up: 'gear' is no field; valid: device_type,"),
    ],
)
def test_an_exciter_that_names_what_the_map_lacks_is_refused(changes: dict[str, Any], said: str) -> None:
    (found,) = wrong("maxon-epos4", "exciter", **changes)
    assert found.startswith(said)


def test_a_drive_without_a_dead_man_is_refused() -> None:
    contract = device_kind("maxon-epos4").contract
    fields = tuple(f for f in contract.fields if f.name != "watchdog")
    (found,) = wrong("maxon-epos4", "exciter", replace(contract, fields=fields))
    assert found.startswith(
        "a drive that goes on with its last set-point needs a dead-man: a field 'watchdog' of 1016h"
    )


def test_set_points_that_wait_for_a_sync_are_refused() -> None:
    contract = device_kind("maxon-epos4").contract
    (pdo,) = contract.receives
    (found,) = wrong("maxon-epos4", "exciter", replace(contract, receives=(replace(pdo, transmission=1),)))
    assert found.startswith("stream = 'set_point' must hold one field in %, and be taken when it arrives")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"level": "state"}, "level: 'state' is no number field that can be written and read; valid: remote, output,"),
        ({"actual": "measured"}, "actual = 'measured' is no number field that can be read; valid: device_class,"),
        ({"ready": "wake"}, "ready = 'wake' is no command; valid: remote, on, off"),
        ({"off": ""}, "on and off: give both, or none"),
    ],
)
def test_a_source_that_names_what_the_map_lacks_is_refused(changes: dict[str, Any], said: str) -> None:
    (found,) = wrong("ea-psb", "bias", **changes)
    assert found.startswith(said)
