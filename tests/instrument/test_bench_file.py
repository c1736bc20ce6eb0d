"""Bench files, and values of any file: what is wrong is said once, with file, key and remedy."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import BaseModel, Field, ValidationError

from palpate.instrument.bench.description import BenchDescription, read_bench, recorded_bench
from palpate.instrument.bench.role_maps import ROLE_MAPS
from palpate.instrument.config import LARGEST_FILE, Config, check
from palpate.instrument.contracts.maps.map_file import LineTable
from palpate.instrument.errors import ConfigError
from palpate.instrument.quantity import Seconds

GOOD = """
name = "bench"
force_limit = "8 N"
[link.generator]
kind = "modbus-tcp"
host = "10.0.0.1"
[link.amplifier]
kind = "modbus-tcp"
host = "10.0.0.2"
port = 1502
[link.line]
kind = "modbus-rtu"
port = "/dev/ttyUSB0"
timeout = "200 ms"
[link.can]
kind = "canopen"
interface = "socketcan"
channel = "can0"
[device.signal_generator]
kind = "signal_generator"
link = "generator"
unit = 1
[device.shaker_amplifier]
kind = "shaker_amplifier"
link = "amplifier"
unit = 1
[device.strain_indicator]
kind = "strain_indicator"
link = "line"
unit = 1
[device.positioner]
kind = "positioner"
link = "line"
unit = 2
[device.node_1]
kind = "sensor_node"
link = "can"
node = 1
[device.node_2]
kind = "sensor_node"
link = "can"
node = 2
"""
CHANGER = """
[link.changer]
kind = "modbus-tcp"
host = "10.0.0.3"
[device.sample_changer]
kind = "sample_changer"
link = "changer"
unit = 1
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "bench.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_bench_file_is_read_with_defaults_and_units(tmp_path: Path) -> None:
    bench = read_bench(written(tmp_path, GOOD))
    assert bench.force_limit == 8.0
    assert bench.links["line"].timeout == 0.2
    assert (bench.links["generator"].port, bench.links["generator"].timeout) == (502, 1.0)
    assert [device.unit for device in bench.devices] == [1, 1, 1, 2, 1, 2]
    assert bench.devices[1].settings.gain == 2.0


@pytest.mark.parametrize("unit", [0, 255])
def test_a_device_on_tcp_can_be_at_the_unit_that_means_the_address_itself(tmp_path: Path, unit: int) -> None:
    on_tcp = GOOD.replace('link = "amplifier"\nunit = 1', f'link = "amplifier"\nunit = {unit}')
    assert read_bench(written(tmp_path, on_tcp)).devices[1].unit == unit
    on_a_line = GOOD.replace('link = "line"\nunit = 2', f'link = "line"\nunit = {unit}')
    with pytest.raises(ConfigError, match=f"device.positioner: unit = {unit}: a positioner answers at 1 to 247 alone"):
        read_bench(written(tmp_path, on_a_line))


def test_a_unit_that_no_device_has_is_refused_with_those_that_there_are(tmp_path: Path) -> None:
    text = GOOD.replace('link = "amplifier"\nunit = 1', 'link = "amplifier"\nunit = 250')
    with pytest.raises(ConfigError, match=r"unit = 250: .* answers at 1 to 247, and on TCP at 0 or 255, which are the"):
        read_bench(written(tmp_path, text))


@pytest.mark.parametrize("baudrate", [300, 4_000_000])
def test_a_line_has_any_baud_rate_that_a_map_can_say(tmp_path: Path, baudrate: int) -> None:
    text = GOOD.replace('port = "/dev/ttyUSB0"', f'port = "/dev/ttyUSB0"\nbaudrate = {baudrate}')
    assert read_bench(written(tmp_path, text)).links["line"].baudrate == baudrate
    assert LineTable(baudrate=baudrate).baudrate == baudrate


@pytest.mark.parametrize(
    ("link", "address", "says"),
    [
        (
            'kind = "modbus-tcp"\nhost = "10.0.0.2"\nport = 1502',
            "unit = 1",
            "link.far: amplifier is the same TCP address; write one [link.NAME] for both",
        ),
        ('kind = "modbus-rtu"\nport = "/dev/ttyUSB0"', "unit = 9", "link.far: line is the same serial line; write one"),
        (
            'kind = "canopen"\ninterface = "socketcan"\nchannel = "can0"',
            "node = 9",
            "link.far: can is the same CAN bus",
        ),
    ],
)
def test_one_device_or_line_is_not_listed_twice_under_two_links(
    tmp_path: Path, link: str, address: str, says: str
) -> None:
    kind = {"modbus-tcp": "sample_changer", "modbus-rtu": "positioner", "canopen": "sensor_node"}[link.split('"')[1]]
    device = f'[device.spare]\nkind = "{kind}"\nlink = "far"\nrole = "{kind}"\n{address}\n'
    with pytest.raises(ConfigError, match=re.escape(says)):
        read_bench(written(tmp_path, f"{GOOD}[link.far]\n{link}\n{device}"))
    other = link.replace("1502", "1503").replace("ttyUSB0", "ttyUSB1").replace("can0", "can1")
    assert read_bench(written(tmp_path, f"{GOOD}[link.far]\n{other}\n{device}")).link


@pytest.mark.parametrize("optional", ["source", "amplifier"])
def test_neither_half_of_an_exciter_is_optional(tmp_path: Path, optional: str) -> None:
    text = 'name = "bench"\n'
    text += '[link.rack]\nkind = "modbus-tcp"\nhost = "10.0.0.1"\n'
    for unit, (role, kind) in enumerate((("source", "signal_generator"), ("amplifier", "shaker_amplifier")), 1):
        text += f'[device.{role}]\nkind = "{kind}"\nlink = "rack"\nunit = {unit}\n'
        text += f"optional = {str(role == optional).lower()}\n"
    with pytest.raises(ConfigError, match=rf"device\.{optional}: optional: what drives cannot be left out"):
        read_bench(written(tmp_path, text))


@pytest.mark.parametrize("more", ["", CHANGER])
def test_a_written_bench_file_reads_back_the_same_and_has_every_key(tmp_path: Path, more: str) -> None:
    text = read_bench(written(tmp_path, GOOD + more)).to_toml()
    assert 'baudrate = 115200\nparity = "N"' in text
    assert 'gain = 2.0\ncurrent_limit = "5.0 A"' in text
    assert ("sample_changer" in text) == bool(more)
    assert read_bench(written(tmp_path, text)).to_toml() == text


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('force_limit = "8 N"', 'force_limit = "8 kPa"', r"force_limit: '8 kPa' is in kPa where N belongs"),
        ('force_limit = "8 N"', "force_limit = 8", r"force_limit: 8 needs a unit"),
        ('force_limit = "8 N"', 'force_limit = "-1 N"', "force_limit: .* is too small; give more than 0 N"),
        ('force_limit = "8 N"', 'force_limt = "8 N"', r"force_limt: unknown key \(did you mean 'force_limit'\?\)"),
        ("port = 1502", "prot = 1502", r"link.amplifier: prot: unknown key \(did you mean 'port'\?\)"),
        ("port = 1502", "port = 70000", "link.amplifier: port: 70000 is too large; give at most 65535"),
        ("node = 2", "node = 1", r"node_1 and node_2 both have the address 1 on can"),
        ("node = 2", "node = 0", r"device.node_2: node: 0 is too small"),
        ("node = 2", "unit = 2", r"device.node_2: a device on link can needs a node and must have no unit"),
        ('host = "10.0.0.1"', "", r"link.generator: host: is missing"),
        ('name = "bench"', "name = ", r"is not TOML"),
    ],
)
def test_a_bad_key_is_named_with_file_value_and_remedy(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in GOOD
    path = written(tmp_path, GOOD.replace(old, new))
    with pytest.raises(ConfigError, match=says) as caught:
        read_bench(path)
    assert str(path) in str(caught.value)


def test_all_problems_of_a_file_come_at_once(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD.replace("port = 1502", "port = 0").replace("200 ms", "200 mV"))
    with pytest.raises(ConfigError) as caught:
        read_bench(path)
    assert len(str(caught.value).splitlines()) == 2


@pytest.mark.parametrize(
    ("limit", "stood", "says"),
    [
        (
            "1e6 N",
            "",
            "force_limit: 1e+06 N is more than load cell, sensor and samples are known to stand (20 N)",
        ),
        ("20.1 N", "", 'or write what those of this bench stand: withstands = "FORCE" at the top'),
        ("51 N", "50 N", "force_limit: 51 N is more than load cell, sensor and samples are known to stand (50 N)"),
        ("1e6 N", "1e6 N", "withstands: '1e6 N' is too large; give at most 1000 N"),
        ("5 N", "5 N", "withstands: '5 N' is too small; give more than 20 N"),
    ],
)
def test_a_force_limit_above_what_is_known_to_be_stood_is_refused(
    tmp_path: Path, limit: str, stood: str, says: str
) -> None:
    given = f'"{limit}"\n' + (f'withstands = "{stood}"' if stood else "")
    with pytest.raises(ConfigError, match=re.escape(says)):
        read_bench(written(tmp_path, GOOD.replace('"8 N"', given)))


def test_a_force_limit_above_it_is_recorded_with_the_line_that_allows_it(tmp_path: Path) -> None:
    assert "withstands" not in read_bench(written(tmp_path, GOOD)).to_toml()
    bench = read_bench(written(tmp_path, GOOD.replace('"8 N"', '"40 N"\nwithstands = "50 N"')))
    assert 'force_limit = "40.0 N"\nwithstands = "50.0 N"' in bench.to_toml()


def test_a_silent_device_is_not_waited_for_longer_than_the_watchdog_or_the_program_allows(tmp_path: Path) -> None:
    late = GOOD.replace("port = 1502", 'port = 1502\ntimeout = "1.1 s"').replace("200 ms", "10 s")
    path = written(tmp_path, late)
    with pytest.raises(ConfigError) as caught:
        read_bench(path)
    assert str(caught.value).splitlines() == [
        f"{path}: link.amplifier: timeout = 1.1 s: a device that falls silent is waited for 2.2 s, and the watchdog of "
        'shaker_amplifier (2 s) is not fed meanwhile; write timeout = "1 s" or less',
        f"{path}: link.line: timeout = 10 s: a device that falls silent is waited for 40 s, and after 20 s this "
        'program counts as hanging, so that the watchdog of shaker_amplifier acts; write timeout = "5 s" or less',
    ]
    written(tmp_path, recorded_bench(late, "a run").patient().to_toml())
    assert [link.timeout for link in read_bench(path).links.values()] == [1.0, 1.0, 5.0, 1.0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read: No such file"),
        (b"\xff\xfe\x00", "is not text"),
        (b"#" * (LARGEST_FILE + 1), "larger than"),
    ],
    ids=["missing", "binary", "huge"],
)
def test_a_missing_file_one_that_is_no_text_and_a_huge_one_are_refused(
    tmp_path: Path, content: bytes | None, message: str
) -> None:
    path = tmp_path / "bench.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=message):
        read_bench(path)


def test_what_is_no_file_is_refused() -> None:
    with pytest.raises(ConfigError, match="is no file"):
        read_bench(Path("/dev/zero"))


def test_limits_of_the_bench_have_safe_defaults() -> None:
    fields = BenchDescription.model_fields
    assert fields["force_limit"].default == 10.0
    assert fields["watchdog"].default == 2.0


# --- What is wrong with a value of a file is told in palpate's words: the value, what is allowed, and what to do

BENCH: dict[str, Any] = {
    "name": "makers",
    "link": {
        "can": {"kind": "canopen", "interface": "socketcan", "channel": "can9"},
        "line": {"kind": "modbus-rtu", "port": "/dev/ttyUSB9"},
    },
    "device": {
        "load_cell": {"kind": "flintec-dad-141", "link": "line", "unit": 1, "inventory": "LAB-1", "span": 10.306},
        "films": {"kind": "canopennode-io", "link": "can", "node": 3, "set_to_link": True},
    },
}


class Everything(Config):
    number: Annotated[float, Field(gt=0, lt=9, strict=True)] = 1.0
    whole: Annotated[int, Field(ge=2, le=8, strict=True)] = 2
    yes: Annotated[bool, Field(strict=True)] = True
    text: Annotated[str, Field(min_length=2, max_length=3)] = "ab"
    name: Annotated[str, Field(min_length=1, pattern="^[a-z]*$")] = "a"
    words: Annotated[tuple[str, ...], Field(min_length=1, max_length=2)] = ("a",)
    one: Literal["fast", "slow"] = "fast"
    time: Annotated[Seconds, Field(ge=1e-3, le=60)] | None = None
    table: dict[str, int] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("number", "x" * 300, f"'{'x' * 199}... is no number; give one without quotes"),
        ("number", float("nan"), "nan is not finite; give a number"),
        ("number", 0.0, "0.0 is too small; give more than 0"),
        ("number", 9.0, "9.0 is too large; give less than 9"),
        ("whole", 1.5, "1.5 is no whole number; give one without quotes"),
        ("whole", 1, "1 is too small; give at least 2"),
        ("whole", 300, "300 is too large; give at most 8"),
        ("yes", 1, "1 is neither true nor false; give one of them without quotes"),
        ("text", 5, "5 is no text; put it in quotes"),
        ("text", "a", "'a' is too short; give at least 2 characters"),
        ("text", "abcd", "'abcd' is too long; give at most 3 characters"),
        ("name", "", "'' is empty; give a text"),
        ("name", "A", "'A' does not have the form ^[a-z]*$"),
        ("words", "ab", "'ab' is no list; put its values in square brackets"),
        ("words", [], "[] has too few values; give at least 1 value"),
        ("words", ["a", "b", "c"], "['a', 'b', 'c'] has too many values; give at most 2 values"),
        ("one", "fas", "'fas' is not known (did you mean 'fast'?); valid: 'fast' or 'slow'"),
        ("time", "70 s", "'70 s' is too large; give at most 60 s"),
        ("time", "1 µs", "'1 µs' is too small; give at least 1 ms"),
        ("table", 3, "3 is no table; give its keys, each with its value"),
    ],
)
def test_a_wrong_value_is_told_with_what_is_allowed(key: str, value: object, message: str) -> None:
    with pytest.raises(ConfigError) as refused:
        check({key: value}, Everything, "lab.toml")
    assert str(refused.value) == f"lab.toml: {key}: {message}"


@pytest.mark.parametrize(
    ("place", "key", "value", "message"),
    [
        (("device", "load_cell"), "unit", 300, "device.load_cell: unit: 300 is too large; give at most 255"),
        (("device", "films"), "node", 128, "device.films: node: 128 is too large; give at most 127"),
        (("device", "films"), "inventry", "A", "unknown key (did you mean 'inventory'?); valid: confirmed, inventory,"),
        (("device", "load_cell"), "span", 1e-300, "1e-300 is too small; give at least 1e-06: the mV of the load cell"),
        (("link", "line"), "parity", "X", "link.line: parity: 'X' is not known; valid: 'N', 'E' or 'O'"),
    ],
)
def test_a_bench_of_makers_devices_is_refused_so(place: tuple[str, str], key: str, value: object, message: str) -> None:
    section, name = place
    tables = BENCH[section]
    told = {**BENCH, section: {**tables, name: {**tables[name], key: value}}}
    with pytest.raises(ConfigError) as refused:
        check(told, BenchDescription, "lab.toml")
    assert message in str(refused.value)


def numbers() -> list[tuple[type[BaseModel], str]]:
    settings = [each.settings for each in ROLE_MAPS.values() if each.settings is not None]
    return [(kind, name) for kind in settings for name, info in kind.model_fields.items() if info.annotation is not int]


@pytest.mark.parametrize("size", [1e-300, 1e300])
def test_no_number_of_a_devices_section_is_without_both_limits(size: float) -> None:
    """A share of 1e-300 divides the effort to infinity, and steps of 1e300 of a display hide every load."""
    for settings, name in numbers():
        for value in (size, *(f"{size:g} {unit}" for unit in ("m", "Hz"))):
            with pytest.raises(ValidationError) as refused:
                settings.model_validate({name: value})
            assert any(error["loc"] == (name,) for error in refused.value.errors())
