"""Why a link does not open, and why no valid answer comes: one sentence for each cause, with its remedy."""

from __future__ import annotations

import errno
import fcntl
import grp
import os
import pwd
import socket
import stat
from pathlib import Path
from urllib.parse import urlsplit

from pymodbus.framer import FramerRTU

TCP_HEADER, PROTOCOL, LENGTH, UNIT, FUNCTION = 6, slice(2, 4), slice(4, 6), 6, 7  # bytes and places of a TCP frame
REFUSED = 0x80  # bit of a function code that marks a refusal
SEARCH = "--tcp"  # stands for a section of the bench file where an address is searched
SHOWN = 8  # bytes that a message shows
PORTS = (("/dev/serial/by-id", "*"), ("/dev", "ttyUSB*"), ("/dev", "ttyACM*"))  # where serial adapters appear
NO_WAY = (errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENETDOWN, errno.EHOSTDOWN, errno.EADDRNOTAVAIL)


def exhausted() -> str:
    """That this program cannot open any file; empty: it can."""
    try:
        os.close(os.open(os.devnull, os.O_RDONLY))
    except OSError as error:
        return f"cannot be opened: {error.strerror} in this program; raise the limit with ulimit -n"
    return ""


# --- TCP -----------------------------------------------------------------------------------------------


def no_connection(host: str, port: int, error: OSError | None, timeout: float, section: str) -> str:
    """Why no connection to a host could be made; `section`: where the bench file says its address."""
    name = f"{host}:{port}"
    if isinstance(error, socket.gaierror):
        if error.errno == socket.EAI_AGAIN:
            return (
                f"the address of {host!r} cannot be looked up now, because no name server answers; check this "
                f"machine's network, or write the IP address as host in {section}"
            )
        return f"no host is called {host!r}; correct host in {section}"
    if isinstance(error, ConnectionRefusedError):
        return (
            f"nothing answers at {name}: the host refuses the connection, so no program listens on this port; correct "
            f"port in {section}, or switch Modbus TCP on at the device"
        )
    if error is not None and error.errno in NO_WAY:
        return (
            f"nothing answers at {name}: no way leads there ({error.strerror}); check this machine's network, and host "
            f"in {section}"
        )
    if error is None or isinstance(error, TimeoutError):
        return (
            f"nothing answers at {name} within {timeout:g} s; check power and network cable of the device, and host in "
            f"{section}"
        )
    return f"nothing answers at {name}: {error.strerror or error}; correct host and port in {section}"


def no_gateway(url: str, timeout: float, section: str) -> str:
    """Why a line behind `socket://HOST:PORT` could not be opened."""
    try:
        found = urlsplit(url)
        host, port = found.hostname, found.port
    except ValueError:
        found, host, port = None, None, None
    if found is None or found.scheme != "socket" or not host or not port:
        return f"{url} is no port; in {section} write a device file such as /dev/ttyUSB0, or socket://HOST:PORT"
    try:
        socket.create_connection((host, port), timeout).close()
    except OSError as error:
        return no_connection(host, port, error, timeout, section)
    return f"{host}:{port} was closed and is open again; see whether another program holds its only connection"


def wrong_on_tcp(request: bytes, came: bytes, name: str, section: str, device: str) -> str:
    """What is wrong with what came in answer to a request on TCP.

    Args:
        request: the frame that was sent.
        came: all bytes that came.
        name: the address, as HOST:PORT.
        section: where the bench file says the address.
        device: where it says the unit id.
    """
    if not came:
        return (
            f"nothing came, although {name} is connected; check unit in {device}, and behind a gateway power and cable "
            "of the device"
        )
    bytes_ = f"{len(came)} bytes came ({came[:SHOWN].hex(' ')})"
    if _is_rtu(came):
        use = f'write kind = "modbus-rtu" and port = "socket://{name}" in {section}'
        if section == SEARCH:
            use = f"search it by --line socket://{name}"
        return f"an RTU frame came: this gateway speaks RTU over TCP; {use}"
    if text := _text(came):
        what = "an HTTP server answers" if came.startswith((b"HTTP/", b"<")) else "a server of text answers"
        return f"{what} ({text!r}), no Modbus device; correct port in {section}: that of Modbus TCP is usually 502"
    if came[PROTOCOL] != b"\0\0" or min(len(came), len(request)) <= FUNCTION:
        return f"{bytes_} that are no reply of Modbus TCP; correct host and port in {section}"
    if came[:2] != request[:2]:
        number, asked = (int.from_bytes(each[:2]) for each in (came, request))
        return (
            f"a reply with transaction number {number} came, {asked} was asked: the gateway gives numbers of its own, "
            f"or answers a request that was given up; update it, or raise timeout in {section}"
        )
    if came[UNIT] != request[UNIT]:
        return (
            f"a reply of unit {came[UNIT]} came, unit {request[UNIT]} was asked; write unit = {came[UNIT]} in {device} "
            "if that is the device, or correct the unit id at the device"
        )
    length = int.from_bytes(came[LENGTH])
    if TCP_HEADER + length != len(came) or not _right_size(request, came):
        return (
            f"a reply of wrong length came ({len(came) - TCP_HEADER} bytes behind its header, which says {length}, to "
            f"{_asked(request)}); update the firmware of the device or gateway, or correct the device's map"
        )
    if came[FUNCTION] & ~REFUSED != request[FUNCTION]:
        return (
            f"a reply to function {came[FUNCTION] & ~REFUSED} came, {request[FUNCTION]} was asked; look for another "
            "firmware than the map's, or for a gateway that mixes replies up"
        )
    return f"{bytes_} that contradict themselves; update the firmware of the device or gateway"


def _asked(request: bytes) -> str:
    return f"function {request[FUNCTION]}"


def _right_size(request: bytes, came: bytes) -> bool:
    """Whether a reply is as long as its function says, if this is a refusal, a confirmation or a read of registers."""
    function, size = came[FUNCTION], len(came) - FUNCTION
    if function & REFUSED:
        return size == 2
    if function in (3, 4) and function == request[FUNCTION]:
        return size == 2 + came[FUNCTION + 1] == 2 + 2 * int.from_bytes(request[-2:]) if size > 1 else False
    return size == 5 if function in (5, 6, 15, 16) else True


def _is_rtu(came: bytes) -> bool:
    return len(came) > 4 and FramerRTU.compute_CRC(came[:-2]) == int.from_bytes(came[-2:])


def _text(came: bytes) -> str:
    """The first line of bytes that are text; empty: they are none."""
    line = came[:60].splitlines()[0] if came.strip() else b""
    return line.decode() if len(line) > 3 and line.isascii() and line.decode().isprintable() else ""


# --- serial ports --------------------------------------------------------------------------------------


def no_port(port: str, setting: str, section: str) -> str:
    """Why a serial port could not be opened; `setting`: its baud rate, parity and stop bits, for people."""
    try:
        found = Path(port).stat()
    except FileNotFoundError:
        there = [str(each) for folder, pattern in PORTS for each in sorted(Path(folder).glob(pattern))]
        listed = f"there are {', '.join(there)}" if there else "no USB adapter is plugged in"
        return f"there is no serial port {port}; {listed}: correct port in {section}, or plug the adapter in"
    except OSError as error:
        return f"serial port {port} cannot be looked at: {error.strerror}; correct port in {section}"
    if not stat.S_ISCHR(found.st_mode):
        what = "a folder" if stat.S_ISDIR(found.st_mode) else "a file"
        return f"{port} is no serial port but {what}; correct port in {section}"
    try:
        file = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except PermissionError:
        return f"serial port {port} may not be opened by {_user(os.getuid())}; {_rights(found)}"
    except OSError as error:
        if error.errno == errno.EBUSY:
            return _held(port, section)
        return f"serial port {port} has nothing behind it ({error.strerror}); plug the adapter in anew"
    try:
        if not os.isatty(file):
            return f"{port} is a device, but no serial port; correct port in {section}"
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return _held(port, section)
    finally:
        os.close(file)
    return f"serial port {port} does not take {setting}; correct baudrate, parity and stopbits in {section}"


def _held(port: str, section: str) -> str:
    return (
        f"serial port {port} is held by another program; end that (fuser {port} tells its number), or correct port in "
        f"{section}"
    )


def _rights(found: os.stat_result) -> str:
    """Who may open a file, and how to become one of them."""
    try:
        group = grp.getgrgid(found.st_gid).gr_name
    except KeyError:
        group = str(found.st_gid)
    if found.st_mode & (stat.S_IRGRP | stat.S_IWGRP) and found.st_gid:
        return (
            f"its group {group} may: add yourself to group {group} (sudo usermod -aG {group} {_user(os.getuid())}), "
            "then log in anew"
        )
    return f"it belongs to {_user(found.st_uid)}, who alone may; ask for a udev rule that gives it to a group of yours"


def _user(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"user {number}"


def wrong_on_line(came: bytes, port: str, section: str, device: str) -> str:
    """What is wrong with what came in answer to a request on a serial line; `device`: where its unit id is said."""
    over = port.partition("://")[2] if "://" in port else ""
    setting = f"the setting of the gateway's serial side at {over}" if over else f"baudrate and parity in {section}"
    if not came:
        return f"nothing came; check power and cable of the device, unit in {device}, and {setting}"
    return (
        f"{len(came)} bytes came that are no valid reply ({came[:SHOWN].hex(' ')}); check {setting}, and look for "
        "noise, an echo, or two devices at this unit id"
    )


# --- CAN -----------------------------------------------------------------------------------------------

NO_CAN = (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT, errno.ESOCKTNOSUPPORT)
NETWORK = Path("/sys/class/net")
CAN_HARDWARE = "280"  # type of a CAN interface (ARPHRD_CAN)
UP = 1  # flag of an interface that is up


def no_bus(interface: str, channel: str, bitrate: int, error: Exception, section: str) -> str:
    """Why a CAN bus could not be opened."""
    name = f"{interface}:{channel}"
    number = getattr(error, "errno", None)
    if interface == "socketcan":
        if number in NO_CAN:
            return f"CAN bus {name} cannot be opened: this system's kernel has no CAN; load it (sudo modprobe can_raw)"
        if number == errno.ENODEV or not (NETWORK / channel).exists():
            there = sorted(path.name for path in NETWORK.iterdir() if _read(path / "type") == CAN_HARDWARE)
            listed = f"there are {', '.join(there)}" if there else "this machine has none"
            return (
                f"CAN bus {name} cannot be opened: there is no CAN interface {channel}; {listed}: correct channel in "
                f"{section}, or plug the adapter in"
            )
        if is_down(interface, channel):
            return down(name, channel, bitrate)
    if isinstance(error, (ImportError, NameError)) or "not found" in str(error) or "import" in str(error):
        return (
            f"CAN bus {name} cannot be opened: the driver software of {interface} adapters is not installed ({error}); "
            f"install the maker's, or correct interface in {section}"
        )
    return f"CAN bus {name} cannot be opened: {error}; check interface and channel in {section}"


def is_down(interface: str, channel: str) -> bool:
    """Whether a CAN interface of the system is there, and not up."""
    flags = _read(NETWORK / channel / "flags")
    return interface == "socketcan" and bool(flags) and not int(flags, 16) & UP


def down(name: str, channel: str, bitrate: int) -> str:
    """That an interface of the system is down."""
    return f"CAN bus {name} is down; bring it up: sudo ip link set {channel} up type can bitrate {bitrate}"


def _read(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def lost_bus(interface: str, channel: str, bitrate: int, error: Exception, section: str) -> str:
    """Why a frame could not be sent on an open bus."""
    name = f"{interface}:{channel}"
    number = getattr(error, "errno", None) or getattr(error, "error_code", None)
    if number == errno.ENETDOWN or is_down(interface, channel):
        return down(name, channel, bitrate)
    if number in (errno.ENODEV, errno.ENXIO):
        return f"CAN bus {name} is gone: its adapter was pulled out; plug it in, and run again"
    if number == errno.ENOBUFS:
        return f"CAN bus {name} takes no more frames: {alone(section)}"
    return f"CAN bus {name} failed: {error}; check adapter and termination"


def alone(section: str) -> str:
    """That no node acknowledges what is sent."""
    return (
        "nobody on the bus acknowledges a frame, so this program is alone on it; check power and cable of the nodes, "
        f"the termination, and bitrate in {section}"
    )
