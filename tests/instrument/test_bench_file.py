"""Bench files: what is wrong is said once, with file, key and remedy."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from palpate.instrument.bench.description import BenchDescription, read_bench
from palpate.instrument.config import LARGEST_FILE
from palpate.instrument.errors import ConfigError

GOOD = """
name = "bench"
force_limit = "8 N"
[signal_generator]
host = "10.0.0.1"
[shaker_amplifier]
host = "10.0.0.2"
port = 1502
[line]
port = "/dev/ttyUSB0"
timeout = "200 ms"
[can]
interface = "socketcan"
channel = "can0"
nodes = [1, 2]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "bench.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_bench_file_is_read_with_defaults_and_units(tmp_path: Path) -> None:
    bench = read_bench(written(tmp_path, GOOD))
    assert bench.force_limit == 8.0
    assert bench.line.timeout == 0.2
    assert bench.signal_generator.port == 502
    assert (bench.strain_indicator.unit, bench.positioner.unit) == (1, 2)
    assert bench.can.nodes == (1, 2)
    assert bench.sample_changer is None
    assert "sample_changer" not in bench.to_toml()


@pytest.mark.parametrize(
    ("link", "address", "says"),
    [
        ('kind = "modbus-tcp"\nhost = "10.0.0.2"\nport = 1502', "unit = 1", "shaker_amplifier and spare both have"),
        ('kind = "modbus-rtu"\nport = "/dev/ttyUSB0"', "unit = 9", "link.far: line is the same serial line; put its"),
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


@pytest.mark.parametrize("more", ["", '[sample_changer]\nhost = "10.0.0.3"\n'])
def test_a_written_bench_file_reads_back_the_same(tmp_path: Path, more: str) -> None:
    bench = read_bench(written(tmp_path, GOOD + more))
    assert (bench.sample_changer is not None) == bool(more)
    assert read_bench(written(tmp_path, bench.to_toml())) == bench


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('force_limit = "8 N"', 'force_limit = "8 kPa"', r"force_limit: '8 kPa' is in kPa where N belongs"),
        ('force_limit = "8 N"', "force_limit = 8", r"force_limit: 8 needs a unit"),
        ('force_limit = "8 N"', 'force_limit = "-1 N"', "force_limit: .* is too small; give more than 0 N"),
        ('force_limit = "8 N"', 'force_limt = "8 N"', r"force_limt: unknown key \(did you mean 'force_limit'\?\)"),
        ("port = 1502", "prot = 1502", r"shaker_amplifier.prot: unknown key \(did you mean 'port'\?\)"),
        ("port = 1502", "port = 70000", "shaker_amplifier.port: 70000 is too large; give at most 65535"),
        ("nodes = [1, 2]", "nodes = [1, 1]", r"can.nodes: node ids \[1, 1\] repeat"),
        ("nodes = [1, 2]", "nodes = [0]", r"can.nodes.0: "),
        ("nodes = [1, 2]", "nodes = []", r"can.nodes: "),
        ('host = "10.0.0.1"', "", r"signal_generator.host: is missing"),
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
    path = written(tmp_path, GOOD.replace("port = 1502", "port = 0").replace("8 N", "8 kPa"))
    with pytest.raises(ConfigError) as caught:
        read_bench(path)
    assert len(str(caught.value).splitlines()) == 2


def test_a_missing_file_text_that_is_none_and_a_huge_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        read_bench(tmp_path / "absent.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="is not text"):
        read_bench(binary)
    with pytest.raises(ConfigError, match="is no file"):
        read_bench(Path("/dev/zero"))
    huge = tmp_path / "huge.toml"
    huge.write_text("#" * (LARGEST_FILE + 1))
    with pytest.raises(ConfigError, match="larger than"):
        read_bench(huge)


def test_limits_of_the_bench_have_safe_defaults() -> None:
    fields = BenchDescription.model_fields
    assert fields["force_limit"].default == 10.0
    assert fields["watchdog"].default == 2.0
