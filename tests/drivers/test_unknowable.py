"""Devices that tell nothing of themselves, and links that cannot suit all their devices, in a bench file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.clock import WallClock
from palpate.instrument.bench.description import BenchDescription, read_bench
from palpate.instrument.errors import BenchError, ConfigError, LinkError
from palpate.procedures.lab import operator as console

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


def bench(folder: Path, *maps: dict[str, Any], link: str = "", **keys: dict[str, str]) -> BenchDescription:
    """A bench of devices that the maps describe, on one link; `keys`: more of the section of a device."""
    text = f'name = "lab"\n[link.rack]\n{link or RACK}\n'
    for unit, given in enumerate(maps, 3):
        name = given.get("name", "output-8")
        said = {"name": name, "known_by": "nothing", "baudrate": 9600, "parity": "N", "more": "", **given}
        (folder / f"{name}.toml").write_text(MAP.format_map(said), encoding="utf-8")
        section = {"map": f'"{name}.toml"', "link": '"rack"', "unit": str(unit)} | keys.get(f"device_{unit}", {})
        text += f"[device.device_{unit}]\n" + "".join(f"{key} = {value}\n" for key, value in section.items())
    (folder / "bench.toml").write_text(text, encoding="utf-8")
    return read_bench(folder / "bench.toml")


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
        bench(tmp_path, given, **keys)


def test_a_known_device_that_tells_no_serial_number_can_have_a_label_instead(tmp_path: Path) -> None:
    (found,) = bench(tmp_path, KNOWN, **LABELLED).devices
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
        bench(tmp_path, *maps)
    assert len(bench(tmp_path, *maps, device_4={"set_to_link": "true"}).devices) == 2


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
    described = bench(tmp_path, {}, link=TCP, device_3={"inventory": '"LAB-12"', "confirmed": confirmed})
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
