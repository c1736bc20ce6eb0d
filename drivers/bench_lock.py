"""Lets one program at a time use a bench, by a lock on each of its addresses, taken before any device is opened."""

from __future__ import annotations

import errno
import fcntl
import getpass
import hashlib
import json
import os
import shlex
import socket
import stat
import sys
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol, Self
from urllib.parse import urlsplit

from palpate.instrument.bench.links import Link, SerialLine, TcpLink
from palpate.instrument.errors import BenchError, BenchInUse, ConfigError
from palpate.instrument.own_process import Ends

FOLDER = Path("/tmp/palpate-benches")  # the same for all users, independently of $TMPDIR
FOR_ALL = 0o666  # so that a lock file of one user does not keep out another
LONGEST = 300  # greatest number of characters of a command in a message


class Linked(Protocol):
    """What has links: the description of a bench, or a search for devices."""

    @property
    def links(self) -> Mapping[str, Link]: ...


class BenchLock:
    """A context manager: inside it no other program of this machine opens a bench that shares an address with this one.

    The addresses count, not the bench file. The operating system holds the locks, and releases them when the program
    ends in any way; a lock file that is left behind locks nothing.

    Raises BenchInUse: another program has one of the addresses. BenchError: no lock can be written.
    """

    def __init__(self, description: Linked, folder: Path = FOLDER) -> None:
        self._addresses = addresses(description)
        self._folder = folder
        self._stack = Ends()

    def __enter__(self) -> Self:
        with Ends() as stack:
            for address in self._addresses:
                _take(self._folder, address, stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()


def addresses(description: Linked) -> list[str]:
    """The addresses of a bench as texts, in the order in which they are locked.

    A TCP link is identified by the IP addresses of its host with the port, a serial line by the device file that its
    names lead to, and a CAN bus by its interface and channel. python-can's "virtual" bus does not leave the process.
    """
    return sorted(set().union(*map(_addresses, description.links.values())))


def check_apart(description: Linked) -> None:
    """Raises ConfigError: two links lead to one address, by whatever names; a device may take only one connection."""
    first: dict[str, str] = {}
    for name, link in description.links.items():
        for address in _addresses(link):
            if (other := first.setdefault(address, name)) != name:
                raise ConfigError(
                    f"link.{name} and link.{other} both lead to {address}; write one [link.NAME] for both, and put all "
                    "their devices on it"
                )


def _addresses(link: Link) -> set[str]:
    if isinstance(link, TcpLink):
        return _tcp_addresses(link.host, link.port)
    if isinstance(link, SerialLine):
        if "://" not in link.port:
            return {f"serial port {os.path.realpath(link.port)}"}
        with suppress(ValueError):  # opening it will say what is wrong
            url = urlsplit(link.port)
            if url.hostname is not None and url.port is not None:
                return _tcp_addresses(url.hostname, url.port)
        return {f"serial port {link.port}"}
    process = f" of process {os.getpid()}" if link.interface == "virtual" else ""
    return {f"CAN bus {link.interface}:{link.channel}{process}"}


def _tcp_addresses(host: str, port: int) -> set[str]:
    return {f"TCP port {port} of {number}" for number in _numbers(host)}


def _numbers(host: str) -> set[str]:
    try:
        return {str(address[0]) for *_, address in socket.getaddrinfo(host, None)}
    except (OSError, ValueError):  # no such host, which opening the device will report
        return {host.lower()}


def _take(folder: Path, address: str, stack: Ends) -> None:
    """Lock an address until the end of `stack`."""
    path = folder / f"{hashlib.sha256(address.encode()).hexdigest()[:32]}.lock"
    try:
        while True:
            with ExitStack() as undo:
                file = _open(path)
                undo.callback(os.close, file)
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    raise BenchInUse(
                        f"the bench is in use: {address} is held by {_holder(file)}; wait for it or end it"
                    ) from None
                if _is(file, path):  # else its last holder has just removed it, and others lock the new file
                    undo.pop_all()
                    break
    except OSError as error:
        raise BenchError(
            f"{path}: the bench cannot be locked: {error.strerror or error}; remove what stands there, and see that "
            f"{folder} is a folder in which all who use the bench can write"
        ) from None
    stack.close_in_child(file)
    stack.callback(_give_back, file, path)
    with suppress(OSError):  # on a full disk the lock holds without the name of its holder
        os.ftruncate(file, 0)
        os.pwrite(file, _ourselves(), 0)


def _open(path: Path) -> int:
    """Open the file of a lock, or make it if there is none (Linux refuses to do both at once for another user's file).

    Raises OSError: it cannot be opened, or it is no lock file: in a folder in which everybody may write, somebody may
    have put a link to a file that must not be overwritten.
    """
    while True:
        with suppress(FileExistsError):
            path.parent.mkdir()
            path.parent.chmod(0o1777)
        if not stat.S_ISDIR(path.parent.lstat().st_mode):
            raise NotADirectoryError(errno.ENOTDIR, f"{path.parent} is no folder")
        with suppress(FileNotFoundError):
            return _plain_file(os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK))
        with suppress(FileExistsError):
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW)
            os.fchmod(file, FOR_ALL)
            return file


def _plain_file(file: int) -> int:
    """Check that an open file is an ordinary one with at most one name (none if it was removed), and return it.

    Raises OSError: it is another kind of file, or has a second name; it is closed.
    """
    found = os.fstat(file)
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
        os.close(file)
        raise OSError(errno.EINVAL, "that is no lock, or it is a file with a second name")
    return file


def _is(file: int, path: Path) -> bool:
    """Whether an open file is still the one at this path."""
    try:
        return os.path.samestat(os.fstat(file), path.lstat())
    except FileNotFoundError:
        return False


def _give_back(file: int, path: Path) -> None:
    with suppress(OSError):  # another user's file cannot be removed; it stays, and locks nothing
        path.unlink()
    os.close(file)


def _ourselves() -> bytes:
    """This process, its user and its command, for the message to others that the bench is in use."""
    command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
    since = f"{datetime.now(UTC).astimezone():%Y-%m-%d %H:%M:%S}"
    return json.dumps({"pid": os.getpid(), "user": _user(), "command": command[:LONGEST], "since": since}).encode()


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user without a name, as in a container
        return str(os.getuid())


def _holder(file: int) -> str:
    """The holder of a lock, from the lock's file, without control characters because anybody may have written it."""
    try:
        content = json.loads(os.pread(file, 4096, 0))
        pid, user, command, since = (_plain(content[name]) for name in ("pid", "user", "command", "since"))
    except (ValueError, KeyError, TypeError, RecursionError):
        return "another program"
    return f"process {pid} of {user} ({command}) since {since}"


def _plain(text: object) -> str:
    """A short text without control characters, which could move a terminal's cursor."""
    return "".join(character if character.isprintable() else "?" for character in str(text))[:LONGEST]
