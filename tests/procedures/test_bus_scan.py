"""palpate bus scan: what it tells, and the bench file that it begins."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.drivers.scan import FoundDevice
from palpate.instrument.bench.description import read_bench
from palpate.instrument.bench.kinds import all_kinds
from palpate.instrument.bench.links import SerialLine, TcpLink
from palpate.instrument.contracts.maps.map_file import SHIPPED, read_map
from palpate.procedures.lab.before import begun_bench
from palpate.procedures.lab.scan import ScanPlan
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.twin import Twin
from palpate.simulators.wire.device import SimulatedPlace
from palpate.simulators.wire.modbus import Servers
from tests.procedures.conftest import Palpate

OVEN = """
[device]
name = "my-oven"
title = "My oven"
bus = "modbus"
links = ["modbus-tcp", "modbus-rtu"]
vendor = "Maker"
known_by = "marks"
serial = "number"

[[mark]]
field = "model"
value = 77

[field.model]
address = 0
type = "uint16"
meaning = "number of the model"

[field.number]
address = 1
type = "uint16"
meaning = "serial number"
"""


@pytest.fixture
def oven(tmp_path: Path) -> Iterator[tuple[Path, int]]:
    """The map of an oven, and the port at which its twin answers, whatever the unit id."""
    path = tmp_path / "oven.toml"
    path.write_text(OVEN)
    kind: Any = SimpleNamespace(contract=read_map(path).contract)
    rig: Any = None
    twin = Twin.at(SimulatedPlace(VirtualClock(), rig, 1, "SIM-OV-0042", None, kind, lambda _role: None))
    with Servers() as servers:
        yield path, servers.serve_tcp(1, twin)


def test_a_device_is_found_with_its_map_and_the_bench_file_can_be_used(
    palpate: Palpate, oven: tuple[Path, int], tmp_path: Path
) -> None:
    path, port = oven
    out = tmp_path / "begun.toml"
    address = f"--tcp=127.0.0.1:{port}"
    spoken = palpate("bus", "scan", address, "--units=1-2", f"--map={path}", f"--out={out}", "--json")
    assert spoken.status == 0
    (device,) = json.loads(spoken.out)["devices"]
    assert (device["unit"], device["fits"], device["serial"]) == (1, ["my-oven"], "42")
    (listed,) = read_bench(out).devices
    assert (listed.kind.name, listed.unit) == ("my-oven", 1)


@pytest.mark.parametrize(("units", "found"), [("255", 255), ("0", 0), ("3-4", 0)])
def test_a_device_is_found_at_the_unit_that_means_its_address_itself(
    palpate: Palpate, oven: tuple[Path, int], tmp_path: Path, units: str, found: int
) -> None:
    path, port = oven
    out = tmp_path / "begun.toml"
    spoken = palpate(
        "bus", "scan", f"--tcp=127.0.0.1:{port}", f"--units={units}", f"--map={path}", f"--out={out}", "--json"
    )
    (device,) = json.loads(spoken.out)["devices"]
    assert (device["unit"], device["fits"]) == (found, ["my-oven"])
    assert read_bench(out).devices[0].unit == found


def test_what_is_impossible_is_refused_before_anything_is_sent(palpate: Palpate) -> None:
    for arguments, message in (
        (["--units=0-3", "--line=/dev/null"], "0 is asked by itself where no other answers"),
        (["--units=4-2", "--tcp=localhost"], "is not within 0 to 247 and 255"),
        (["--units=255", "--line=/dev/null"], "is not within 1 to 247"),
        (["--nodes=128", "--can=virtual:x"], "is not within 1 to 127"),
        ([], "nothing to search"),
        (["--tcp=a b:c:d"], "is no address"),
        (["--tcp=host:70000"], "70000"),
        (["--line=/dev/null", "--line=/dev/null"], "is given twice"),
        (["--line=/dev/null", "--baudrates=fast"], "'fast' is no rate"),
        (["--line=/dev/null", "--baudrates=299"], "299"),
        (["--line=/dev/null", "--parities=X"], "'X' is no parity"),
        (["--tcp=localhost", "--timeout=0 s"], "--timeout 0 s is outside"),
        (["--can=gs_usb:0"], "cannot be told only to listen"),
        (["--can=gs_usb:0", "--talk"], "speaks at one bit rate"),
    ):
        spoken = palpate("bus", "scan", *arguments)
        assert spoken.status == 2, arguments
        assert message in spoken.err


def test_of_kinds_that_a_device_could_be_a_map_of_ones_own_is_told_first_and_named_by_its_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    text = (SHIPPED / "seneca-z-sg2.toml").read_text(encoding="utf-8")
    file.write_text(text.replace('"seneca-z-sg2"', '"mine"').replace('"Z-SG2"', '"Mine"'), encoding="utf-8")
    kinds = ScanPlan.asked(
        tcp=["localhost"], lines=[], can=None, units="1", nodes="1", baudrates=None, parities=None, every=False,
        bitrates=None, listen=1.0, talk=False, timeout=0.2, within=60.0, maps=[file],
    ).kinds  # fmt: skip
    could_be = tuple(kind.name for kind in kinds if kind.name in ("laumas-tlb4", "mine"))
    assert could_be == ("mine", "laumas-tlb4")
    line = SerialLine(port="/dev/ttyS9", baudrate=9600)
    assert f'# map = "{file}"\n' in begun_bench([FoundDevice("modbus-rtu", line, 4, candidates=could_be)], kinds)


def test_a_bench_file_lists_what_is_known_and_comments_on_the_rest() -> None:
    line = SerialLine(port="/dev/ttyS9", baudrate=9600)
    tcp = TcpLink(host="rig.lab")
    text = begun_bench(
        [
            FoundDevice("modbus-tcp", tcp, 1, "Palpate SG-1", "1", ("signal_generator",)),
            FoundDevice("modbus-rtu", line, 4, "", "", (), ("flintec-dad-141",)),
            FoundDevice("modbus-rtu", line, 5, "Acme 9000"),
        ],
        all_kinds(),
    )
    assert 'kind = "signal_generator"\nlink = "tcp"\nunit = 1\n' in text
    assert "# unit 4 on line answers, and is not known: it tells nothing\n# could be: flintec-dad-141\n" in text
    assert "# unit 5 on line answers, and is not known: Acme 9000\n# could be: no kind that has a map\n" in text
    assert '# port = "/dev/ttyS9"' in text
    assert begun_bench([], []).startswith("# no device is known yet")
