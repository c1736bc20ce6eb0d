"""Map files: each is a contract, proved by its frames; what is wrong is said with file, table, key and value."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import pytest

from palpate.instrument.bench.description import read_bench
from palpate.instrument.bench.kinds import check_identities, device_kind, kind_in_file
from palpate.instrument.contracts.maps.golden_frames import prove
from palpate.instrument.contracts.maps.map_file import SHIPPED, read_map, shipped
from palpate.instrument.errors import ConfigError, UnknownName

# A transmitter after those of the LAUMAS family; its two frames are worked out by hand in the manual's words
TRANSMITTER = """
[device]
name = "transmitter"
title = "weight transmitter"
bus = "modbus"
links = ["modbus-rtu"]
vendor = "Maker"
product = "TX-1"
revision = "1"
known_by = "nothing"
[field.command]
address = 5
type = "uint16"
meaning = "order"
access = "wo"
choices = { save = 99 }
[field.status]
address = 6
type = "uint16"
meaning = "status"
bits = { gross_negative = 7, net_negative = 8, stable = 11 }
[field.gross]
address = 7
type = "uint32"
meaning = "gross weight"
unit = "kg"
sign = ["status", "gross_negative"]
[field.net]
address = 9
type = "uint32"
meaning = "net weight"
unit = "kg"
sign = ["status", "net_negative"]
[command.save]
field = "command"
value = "save"
[[frame]]
says = "read status, gross, net"
request = "01 03 00 06 00 05 65 C8"
reply = "01 03 0A 09 00 00 00 04 D2 00 00 03 E8 4D B1"
values = { status = ["net_negative", "stable"], gross = 1234, net = -1000 }
origin = "computed"
[[frame]]
says = "command save"
request = "01 10 00 05 00 01 02 00 63 E6 2C"
reply = "01 10 00 05 00 01 11 C8"
origin = "computed"
"""


def written(folder: Path, text: str = TRANSMITTER) -> Path:
    """A map file."""
    file = folder / "map.toml"
    file.write_text(text, encoding="utf-8")
    return file


def changed(folder: Path, changes: Mapping[str, str]) -> Path:
    """The map with parts of its text replaced, each of which it has once."""
    text = TRANSMITTER
    for old, new in changes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return written(folder, text)


@pytest.mark.parametrize("name", shipped())
def test_each_field_of_a_shipped_map_has_a_frame_that_fits(name: str) -> None:
    found = read_map(SHIPPED / f"{name}.toml")
    proof = prove(found.contract, found.frames)
    assert (proof.problems, proof.without, found.name) == ((), (), name)
    assert device_kind(name).contract == found.contract


def test_a_bench_file_names_a_map_beside_it(tmp_path: Path) -> None:
    written(tmp_path)
    bench = tmp_path / "bench.toml"
    link = '[link.line]\nkind = "modbus-rtu"\nport = "/dev/ttyS9"\n'
    device = f'{link}[device.scale]\nmap = "map.toml"\nlink = "line"\nunit = 1\ninventory = "no. 7"\n'
    bench.write_text(f'name = "b"\n{device}', encoding="utf-8")
    (found,) = read_bench(bench).devices
    assert found.kind.name == "transmitter"
    assert found.kind.map is not None
    bench.write_text(f'name = "b"\n{device.replace("map.toml", "../map.toml")}', encoding="utf-8")
    with pytest.raises(ConfigError, match=r"device.scale: map: '../map.toml' leaves the folder"):
        read_bench(bench)


def test_two_maps_of_one_name_that_say_different_things_cannot_be_on_one_bench(tmp_path: Path) -> None:
    kinds = []
    for number, title in enumerate(("one", "two")):
        folder = tmp_path / str(number)
        folder.mkdir()
        kinds.append(kind_in_file(changed(folder, {'"weight transmitter"': f'"{title}"'})))
    check_identities([kinds[0], kinds[0]])
    with pytest.raises(ConfigError, match=r"0/map.toml and .*1/map.toml: device.name: both are 'transmitter'"):
        check_identities(kinds)


def test_the_map_of_the_documentation_is_one_and_its_frame_fits(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "map.md").read_text(encoding="utf-8")
    device, frame = page.split("```\n")[1], page.split("```\n")[3]
    file = written(tmp_path, device + frame)
    found = read_map(file)
    proof = prove(found.contract, found.frames)
    assert (set(proof.proved), proof.problems) == ({"net", "status"}, ())
    assert set(kind_in_file(file).serves) == {"load_indicator"}


def test_bytes_of_a_frame_may_have_commas_as_some_manuals_print_them(tmp_path: Path) -> None:
    (line,) = [line for line in TRANSMITTER.splitlines() if line.startswith("request") and " 03 " in line]
    found = read_map(changed(tmp_path, {line: line.replace(" ", ",").replace(",=,", " = ")}))
    assert prove(found.contract, found.frames).problems == ()


# --- what is wrong -------------------------------------------------------------------------------------

SCALED = """
[field.decimals]
address = 20
type = "uint16"
meaning = "decimals of the display"
access = "rw"
[field.tare]
address = 11
type = "int32"
meaning = "tare"
scaling = { told_by = "decimals" }
[command.save]"""


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        ("address = 9", "address = 8", "weight transmitter: gross and net overlap at 0x8"),
        ("address = 9", "address = 65535", "net ends at address 65536; the addresses go from 0 to 65535"),
        ("address = 9", "address = -2", "net ends at address -1; the addresses go from 0 to 65535"),
        ("address = 9", 'address = "nine"', "field.net: address: 'nine' is no address; give a number"),
        ("address = 9", "address = true", "field.net: address: True is no whole number"),
        ("address = 9", "address = 9\nscale = 0", "field net: scale = 0; give a finite number other than 0"),
        (
            "address = 9",
            "address = 9\nscal = 2.0",
            "field.net: scal: unknown key .did you mean 'scale'.*; valid: access,",
        ),
        ("address = 9", "address = 9\nchoices = { a = true }", "field.net: choices.a: True is no whole number"),
        (
            "address = 9",
            "address = 9\nmissing = ['1']",
            "field.net: missing.0: '1' is no number; give one without quotes",
        ),
        (
            "[command.save]",
            "[line]\nbitrate = 500000\n[command.save]",
            "line.bitrate: is not for bus = 'modbus'; valid: baudrate, parity, stopbits, unit",
        ),
        (
            "[command.save]",
            "[line]\nunit = 200\n[manners]\nunits = [1, 99]\n[command.save]",
            "line.unit = 200, but manners.units are 1 to 99",
        ),
        (
            'links = ["modbus-rtu"',
            'links = ["canopen"',
            "device.links: 'canopen'; valid for bus = 'modbus', each once:",
        ),
        ("[command.save]", SCALED, "tare: its scale is in decimals, which has access 'rw'; it must be 'ro'"),
        ('value = "save"', 'value = "tare"', "command save: .*command = 'tare' is no choice; valid: save"),
        ('says = "command save"', 'says = "save"', """frame 2: says: 'save': give "read", "write", "command","""),
        ("00 01 11 C8", "00 01 11 C", "frame 2: reply: '.* 11 C' is no message; give bytes as"),
        ('bus = "modbus"', 'bus = "profibus"', "device.bus: 'profibus' is not known; valid: 'modbus' or 'canopen'"),
        ('name = "transmitter"', 'name = "../transmitter"', "device.name: '../transmitter' does not have the form"),
    ],
)
def test_an_impossible_map_is_refused_with_file_table_value_and_what_is_allowed(
    old: str, new: str, wrong: str, tmp_path: Path
) -> None:
    file = changed(tmp_path, {old: new})
    with pytest.raises(ConfigError, match=f"^{re.escape(str(file))}: .*{wrong}"):
        read_map(file)


def test_all_wrong_tables_of_a_map_are_named_at_once(tmp_path: Path) -> None:
    file = changed(tmp_path, {'meaning = "gross weight"': "", 'meaning = "net weight"': "scale = 2"})
    with pytest.raises(ConfigError) as failure:
        read_map(file)
    assert [line.split(": ")[1] for line in str(failure.value).splitlines()] == ["field.gross", "field.net"]


def test_a_map_with_the_name_of_one_of_our_own_kinds_is_refused(tmp_path: Path) -> None:
    file = changed(tmp_path, {'name = "transmitter"': 'name = "positioner"'})
    with pytest.raises(ConfigError, match=r"device.name: 'positioner' is a kind of palpate's own; give another name"):
        kind_in_file(file)


def test_a_map_whose_frame_does_not_fit_is_no_kind(tmp_path: Path) -> None:
    file = changed(tmp_path, {"net = -1000": "net = -1001"})
    wrong = r"frame 1 \(read status, gross, net\): net: -1001 kg wanted \(00 00 03 E9\), -1000 found \(00 00 03 E8\)"
    with pytest.raises(ConfigError, match=f"^{re.escape(str(file))}: {wrong}"):
        kind_in_file(file)


def test_a_table_of_an_unknown_role_is_refused(tmp_path: Path) -> None:
    file = written(tmp_path, f"{TRANSMITTER}\n[role.coffee_machine]\n")
    with pytest.raises(ConfigError, match=r"role.coffee_machine: unknown role of a map 'coffee_machine'"):
        kind_in_file(file)


@pytest.mark.parametrize("name", ["../maps/flintec-dad-141", "/etc/passwd", "", "flintec-dad-141.toml", "x" * 5000])
def test_the_name_of_a_kind_is_no_path(name: str) -> None:
    with pytest.raises(UnknownName):
        device_kind(name)
