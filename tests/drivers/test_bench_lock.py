"""One bench, one program: whoever comes second touches nothing and is told who was first."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from palpate.drivers.bench_lock import BenchLock, addresses
from palpate.instrument.bench.description import BenchDescription, CanBus, SerialLine, TcpAddress
from palpate.instrument.errors import BenchError, BenchInUse
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.scenes.scene import Scene
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


def described(host: str = "192.0.2.1", line: str = "/dev/ttyUSB0", channel: str = "can0") -> BenchDescription:
    """A bench that nobody has."""
    return BenchDescription(
        name="bench",
        signal_generator=TcpAddress(host=host),
        shaker_amplifier={"host": "192.0.2.2"},
        line=SerialLine(port=line),
        can=CanBus(interface="socketcan", channel=channel, nodes=(1,)),
    )


def locks(folder: Path) -> list[Path]:
    return sorted(folder.glob("*"))


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


def test_simulated_benches_do_not_contend(scene: Scene) -> None:
    with SimulatedBench(scene) as one, SimulatedBench(scene) as other, open_bench(one), open_bench(other):
        pass


def test_another_file_or_name_for_the_same_device_is_the_same_bench(tmp_path: Path) -> None:
    line, link = tmp_path / "ttyUSB0", tmp_path / "indicator"
    line.touch()
    link.symlink_to(line)
    first = described("127.0.0.1", str(line), "can0")
    with BenchLock(first, tmp_path / "locks"):
        for second in (
            described("127.0.0.1", "/dev/other", "can1"),
            described("localhost", "/dev/other", "can1"),
            described("192.0.2.7", str(link), "can1"),
            described("192.0.2.7", "/dev/other", "can0"),
        ):
            with pytest.raises(BenchInUse), BenchLock(second, tmp_path / "locks"):
                pass
    other = described("192.0.2.7", "/dev/other", "can1").model_copy(
        update={"shaker_amplifier": described().shaker_amplifier.model_copy(update={"host": "192.0.2.8"})}
    )
    with BenchLock(first, tmp_path / "locks"), BenchLock(other, tmp_path / "locks"):
        pass
    assert locks(tmp_path / "locks") == []


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
        for nonsense in ("[]", "[" * 4096):
            first.write_text(nonsense)
            with pytest.raises(BenchInUse, match="held by another program"):
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
    with BenchLock(described(), tmp_path), pytest.raises(BenchInUse), BenchLock(described(), tmp_path):
        pass


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BenchError, match=r"file/.* cannot be locked"), BenchLock(described(), tmp_path / "file"):
        pass


@pytest.mark.parametrize("put", ["link", "second name", "link to nowhere", "folder", "pipe"])
def test_what_somebody_has_put_in_the_place_of_a_lock_is_neither_followed_nor_overwritten(
    put: str, tmp_path: Path
) -> None:
    """In a folder in which all may write."""
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
