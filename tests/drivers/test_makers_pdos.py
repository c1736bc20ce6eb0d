"""PDOs of a maker's data sheet on the bus: what is fixed is never written, and no node gets a COB-ID of another one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from palpate.drivers.bench import Bench
from palpate.instrument.bench.description import read_bench
from palpate.instrument.contracts.maps.eds import imported
from palpate.instrument.errors import ConfigError, DeviceError
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from tests.sheets import BASE, I16, TAKEN, U32, node, pdo, var

SYNC = var("1005", U32, DefaultValue="0x80") + var("1006", U32) + var("2002", I16, "ro")
ROLE = '\n[role.sensor_node]\nchannels = ["reading"]\nsends_sync = true\n'  # without a role a map has no twin
READING = "0x20020010"
NODE = 2  # in the scene, where the node of the films is the first one


def made(folder: Path, text: str, unit: int | None) -> None:
    """Write the map of a maker's sheet."""
    sheet = folder / "widget.eds"
    sheet.write_text(text + SYNC)
    text = imported(sheet, ("1005", "1006", "2002=reading"), node=unit) + ROLE
    (folder / "widget.toml").write_text(text)


@contextmanager
def served(folder: Path, text: str, unit: int | None = NODE) -> Iterator[Any]:
    """A device of a maker's sheet on a simulated bench, whose driver has connected."""
    made(folder, text, unit)
    scene = read_scene("ideal").with_devices({"widget": {"map": str(folder / "widget.toml")}})
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        yield bench.device("widget")


def write(device: Any, index: int, subindex: int, value: int, size: int = 4) -> None:
    device.link.download("test", device.link.add_node(device.id), index, subindex, value.to_bytes(size, "little"))


def read(device: Any, index: int, subindex: int) -> int:
    return int.from_bytes(device.link.upload("test", device.link.add_node(device.id), index, subindex), "little")


def test_a_fixed_pdo_is_not_written_and_its_twin_refuses_what_the_node_refuses(tmp_path: Path) -> None:
    fixed = pdo(1, "$NODEID+0x280", READING, access="const", at="1")
    with served(tmp_path, BASE + fixed + pdo(0, "$NODEID+0x200", TAKEN, sends=False)) as widget:
        assert read(widget, 0x1801, 1) & 0x7FF == 0x280 + NODE
        assert [read(widget, 0x1A01, sub) for sub in (0, 1)] == [1, int(READING, 16)]
        for index, subindex, size in ((0x1801, 1, 4), (0x1801, 2, 1), (0x1A01, 0, 1), (0x1A01, 1, 4)):
            with pytest.raises(DeviceError, match="Attempt to write a read only object"):
                write(widget, index, subindex, 1, size)
        assert read(widget, 0x1600, 1) == int(TAKEN, 16)  # the other one was set up
        assert widget.differences() == []


def test_a_cob_id_of_one_node_alone_is_written_there_as_it_is(tmp_path: Path) -> None:
    with served(tmp_path, BASE + pdo(0, "0x2A5", READING, at="1")) as widget:
        assert read(widget, 0x1800, 1) & 0x7FF == 0x2A5
        widget.start()
        widget.stop()


def test_a_simulated_bench_gives_a_device_the_node_id_at_which_it_is_known(tmp_path: Path) -> None:
    with served(tmp_path, node("7") + BASE + pdo(0, "0x2A5", READING, at="1"), unit=None) as widget:
        assert (widget.id, read(widget, 0x1800, 1) & 0x7FF) == (7, 0x2A5)


def test_a_bench_with_that_device_at_another_node_id_is_refused_before_anything_is_sent(tmp_path: Path) -> None:
    made(tmp_path, node("7") + BASE + pdo(0, "0x2A5", READING, at="1"), None)
    bench = tmp_path / "bench.toml"
    usual = 'volts_per_unit = 0.01\n[link.can]\nkind = "canopen"\ninterface = "virtual"\nchannel = "a"\n'
    bench.write_text(f'name = "b"\n[device.widget]\nmap = "widget.toml"\nlink = "can"\nnode = 5\n{usual}')
    with pytest.raises(ConfigError) as refused:
        read_bench(bench)
    assert (
        "widget on can: PDO sends_1 has the COB-ID 0x2A5 at node id 7, and none that is known at node id 5; give the "
        "device node id 7, or import the maker's file anew"
    ) in str(refused.value)


@pytest.mark.parametrize("cob_id", [0x2000_0182, 0x0001_0182, 0x80, 0x0, 0x701])
def test_a_twin_refuses_cob_ids_that_no_pdo_may_have(cob_id: int, tmp_path: Path) -> None:
    with served(tmp_path, BASE + pdo(0, "$NODEID+0x180", READING, at="1")) as widget:
        write(widget, 0x1800, 1, 0xC000_0182)
        with pytest.raises(DeviceError, match="range"):
            write(widget, 0x1800, 1, 0x4000_0000 | cob_id)
        for transmission in (0xF1, 0xFB):
            with pytest.raises(DeviceError, match="range"):
                write(widget, 0x1800, 2, transmission, 1)
