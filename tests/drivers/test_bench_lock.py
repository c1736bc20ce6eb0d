"""One bench, one program: whoever comes second touches nothing and is told who was first."""

from __future__ import annotations

import errno
import fcntl
import getpass
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from palpate.drivers.bench_lock import BenchLock, addresses
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.errors import BenchError, BenchInUse
from palpate.simulators.bench import SimulatedBench
from tests.drivers.benches import drive, driving, open_bench

# Locks a file as another program would; it says so, and keeps the lock until it is killed.
HOLD = """
import fcntl, os, sys
file = os.open(sys.argv[1], os.O_RDWR | os.O_CREAT)
fcntl.flock(file, fcntl.LOCK_EX)
os.write(file, sys.argv[2].encode())
os.write(1, b"locked")
os.read(0, 1)
"""


def described(
    host: str = "192.0.2.1",
    line: str = "/dev/ttyUSB0",
    channel: str = "can0",
    interface: str = "socketcan",
    amplifier: str = "192.0.2.2",
) -> BenchDescription:
    """A bench that nobody has."""
    links = {
        "generator": {"kind": "modbus-tcp", "host": host},
        "amplifier": {"kind": "modbus-tcp", "host": amplifier},
        "line": {"kind": "modbus-rtu", "port": line},
        "can": {"kind": "canopen", "interface": interface, "channel": channel},
    }
    devices = {
        "signal_generator": {"kind": "signal_generator", "link": "generator", "unit": 1},
        "shaker_amplifier": {"kind": "shaker_amplifier", "link": "amplifier", "unit": 1},
        "positioner": {"kind": "positioner", "link": "line", "unit": 2},
        "sensor_node_1": {"kind": "sensor_node", "link": "can", "node": 1},
    }
    return BenchDescription(name="bench", link=links, device=devices)


def locks(folder: Path) -> list[Path]:
    return sorted(folder.glob("*"))


def open_files() -> set[str]:
    return {path.name for path in Path("/proc/self/fd").iterdir()}


@pytest.fixture(autouse=True)
def no_file_stays_open() -> Iterator[None]:
    before = open_files()
    yield
    assert open_files() == before


def test_the_second_on_a_bench_touches_nothing_and_is_told_who_was_first(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["/usr/bin/palpate", "sweep", "loads"])
    with open_bench(sim) as first:
        drive(first)
        asked = sim.servers.transactions
        with pytest.raises(
            BenchInUse, match=rf"in use: .* held by process {os.getpid()} .*palpate sweep loads.* since 20"
        ):
            open_bench(sim).__enter__()
        assert sim.servers.transactions == asked
        assert driving(sim)
    with open_bench(sim):
        assert sim.servers.transactions > asked


def elsewhere(host: str = "192.0.2.7", line: str = "/dev/other", channel: str = "can1") -> BenchDescription:
    """Another bench, but for what is given."""
    return described(host, line, channel, amplifier="192.0.2.8")


def test_another_file_or_name_for_the_same_device_is_the_same_bench(tmp_path: Path) -> None:
    line, link = tmp_path / "ttyUSB0", tmp_path / "indicator"
    line.touch()
    link.symlink_to(line)
    first = described("127.0.0.1", str(line), "can0")
    with BenchLock(first, tmp_path / "locks"):
        for second, shared in (
            (elsewhere(host="127.0.0.1"), r"TCP port 502 of 127\.0\.0\.1"),
            (elsewhere(host="localhost"), r"TCP port 502 of 127\.0\.0\.1"),
            (elsewhere(line=str(link)), f"serial port {line}"),
            (elsewhere(channel="can0"), "CAN bus socketcan:can0"),
        ):
            with pytest.raises(BenchInUse, match=f"{shared} is held"), BenchLock(second, tmp_path / "locks"):
                pass
        with BenchLock(elsewhere(), tmp_path / "locks"):
            pass
    assert locks(tmp_path / "locks") == []


@pytest.mark.parametrize(
    ("link", "address"),
    [
        ({"line": "socket://192.0.2.9:4001"}, "TCP port 4001 of 192.0.2.9"),  # no file
        ({"line": "relative"}, f"serial port {Path.cwd() / 'relative'}"),
        ({"interface": "virtual"}, "CAN bus virtual:can0 of process {pid}"),
        ({"interface": "pcan"}, "CAN bus pcan:can0"),
    ],
)
def test_a_line_counts_by_its_file_or_address_and_a_bus_within_the_process_for_that_alone(
    link: dict[str, str], address: str
) -> None:
    assert address.format(pid=os.getpid()) in addresses(described(**link))


def test_a_host_without_numbers_counts_by_its_name_however_it_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """That there is no such host is said when the device is opened."""

    def unknown(*_: object, **__: object) -> None:
        raise OSError("Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    assert "TCP port 502 of rig.lab" in addresses(described("Rig.LAB"))


def test_locks_are_taken_in_one_order_so_that_two_programs_cannot_wait_for_each_other() -> None:
    found = addresses(described())
    assert (len(found), found) == (4, sorted(found))


def test_a_bench_that_is_refused_gives_back_the_addresses_it_had_locked(tmp_path: Path) -> None:
    with BenchLock(described(), tmp_path):
        shared = described("192.0.2.7", "/dev/other", "can1")  # the amplifier alone
        with pytest.raises(BenchInUse, match=r"TCP port 502 of 192\.0\.2\.2 "), BenchLock(shared, tmp_path):
            pass
        assert len(locks(tmp_path)) == len(addresses(described()))


@contextmanager
def another_program(path: Path, says: str) -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(
        [sys.executable, "-S", "-E", "-c", HOLD, str(path), says], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.read(6) == b"locked"
        yield process
        process.kill()


def test_a_lock_of_another_program_holds_until_it_is_killed_whatever_stands_in_it(tmp_path: Path) -> None:
    description = described()
    with BenchLock(description, tmp_path):
        first = locks(tmp_path)[0]
    says = '{"pid": 7, "user": "a", "command": "palpate \\u001b[2J\\u0007", "since": "noon"}'
    with another_program(first, says) as process:
        with pytest.raises(BenchInUse, match=r"held by process 7 of a \(palpate \?\[2J\?\) since noon"):
            BenchLock(description, tmp_path).__enter__()
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert first.exists()
        with BenchLock(description, tmp_path):
            pass


def test_a_lock_that_was_removed_while_it_was_waited_for_is_taken_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its last holder removes the file after we have opened it: a lock on that would keep out nobody."""
    flock = fcntl.flock

    def remove_first(file: int, operation: int) -> None:
        monkeypatch.undo()
        for left in locks(tmp_path):
            left.unlink()
        flock(file, operation)

    monkeypatch.setattr(fcntl, "flock", remove_first)
    with BenchLock(described(), tmp_path):
        assert len(locks(tmp_path)) == len(addresses(described()))
        with pytest.raises(BenchInUse), BenchLock(described(), tmp_path):
            pass


@pytest.mark.parametrize("put", ["link", "second name", "link to nowhere", "folder", "pipe"])
def test_what_somebody_has_put_in_the_place_of_a_lock_is_neither_followed_nor_overwritten(
    put: str, tmp_path: Path
) -> None:
    """All may write in the folder of the locks, so anybody can put something there."""
    folder, precious = tmp_path / "locks", tmp_path / "precious"
    precious.write_text("precious")
    with BenchLock(described(), folder):
        place = locks(folder)[0]
    puts: dict[str, Callable[[], object]] = {
        "link": lambda: place.symlink_to(precious),
        "second name": lambda: os.link(precious, place),
        "link to nowhere": lambda: place.symlink_to(tmp_path / "nowhere"),
        "folder": place.mkdir,
        "pipe": lambda: os.mkfifo(place),
    }
    puts[put]()
    with pytest.raises(BenchError, match=f"{place}: the bench cannot be locked: .*; remove what stands there"):
        BenchLock(described(), folder).__enter__()
    assert precious.read_text() == "precious"
    assert not (tmp_path / "nowhere").exists()
    assert locks(folder) == [place]


def test_a_link_in_the_place_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "locks").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BenchError, match="locks is no folder"), BenchLock(described(), tmp_path / "locks"):
        pass
    assert locks(tmp_path / "elsewhere") == []


def test_on_a_full_disk_a_lock_holds_without_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    with (
        BenchLock(described(), tmp_path),
        pytest.raises(BenchInUse, match="held by another program"),
        BenchLock(described(), tmp_path),
    ):
        pass


def test_locks_serve_all_users(tmp_path: Path) -> None:
    folder = tmp_path / "locks"
    before = os.umask(0o077)
    try:
        with BenchLock(described(), folder):
            assert folder.stat().st_mode & 0o7777 == 0o1777
            assert {path.stat().st_mode & 0o777 for path in locks(folder)} == {0o666}
    finally:
        os.umask(before)


# --- who has it ----------------------------------------------------------------------------------------


def test_a_lock_says_who_has_it_since_when_and_by_which_command_and_nothing_of_who_had_it_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["/usr/bin/palpate", "sweep", "two words"])
    monkeypatch.setattr(getpass, "getuser", lambda: "ada")
    with BenchLock(described(), tmp_path):
        place = locks(tmp_path)[0]
    place.write_text("x" * 5000)  # of who had it before
    with BenchLock(described(), tmp_path):
        said = json.loads(place.read_text())
    assert {name: said[name] for name in ("pid", "user", "command")} == {
        "pid": os.getpid(),
        "user": "ada",
        "command": "palpate sweep 'two words'",
    }
    since = datetime.fromisoformat(said["since"]).astimezone()
    assert abs(datetime.now(UTC) - since) < timedelta(minutes=5)


@pytest.mark.parametrize("failure", [KeyError("uid"), OSError("no user")])
def test_a_user_without_a_name_is_called_by_its_number_and_a_long_command_is_told_in_part(
    failure: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Users of a container often have none."""

    def nameless() -> str:
        raise failure

    monkeypatch.setattr(getpass, "getuser", nameless)
    monkeypatch.setattr(sys, "argv", ["palpate", "x" * 10_000])
    with BenchLock(described(), tmp_path):
        assert json.loads(locks(tmp_path)[0].read_text())["user"] == str(os.getuid())
        with pytest.raises(BenchInUse, match=r"\(palpate x{292}\) since"):
            BenchLock(described(), tmp_path).__enter__()


@pytest.mark.parametrize(
    "says",
    [
        "",
        "no JSON",
        "7",
        "[" * 4096,
        "{}",
        '{"pid": 7, "user": "a", "command": "b"}',
        '"pid user command since"',
        "\udcff",
    ],
)
def test_a_lock_that_does_not_say_who_has_it_still_holds(says: str, tmp_path: Path) -> None:
    with BenchLock(described(), tmp_path):
        for lock in locks(tmp_path):
            lock.write_text(says, errors="surrogateescape")
        with pytest.raises(BenchInUse, match="is held by another program; wait for it or end it"):
            BenchLock(described(), tmp_path).__enter__()


def test_a_lock_of_another_user_that_cannot_be_removed_is_given_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(_path: Path) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(Path, "unlink", refused)
    for _ in range(2):
        with BenchLock(described(), tmp_path):
            assert len(locks(tmp_path)) == len(addresses(described()))


def test_what_cannot_be_locked_is_told_with_its_reason_and_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", full)
    with pytest.raises(
        BenchError, match=rf"^{tmp_path}/[0-9a-f]{{32}}\.lock: .* locked: No locks available; .* {tmp_path} is a folder"
    ):
        BenchLock(described(), tmp_path).__enter__()
