"""Layer setting services (CiA 305): node id and bit rate of a CANopen device that is known by its identity object."""

from __future__ import annotations

import queue
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass

from canopen.lss import LssError, LssMaster

from palpate.drivers.links.can import CanLink
from palpate.instrument.errors import DeviceError, LinkError, LinkTimeout

BIT_TIMING = {1_000_000: 0, 800_000: 1, 500_000: 2, 250_000: 3, 125_000: 4, 50_000: 6, 20_000: 7, 10_000: 8}
UNCONFIGURED = 255  # what a device without a node id tells in its place


@dataclass(frozen=True)
class LssAddress:
    """The four parts of 1018h, which no two devices share."""

    vendor: int
    product: int
    revision: int
    serial: int

    def __str__(self) -> str:
        return " ".join(f"{part:X}h" for part in astuple(self))


class LssDevice:
    """The one device that is in LSS state configuration."""

    def __init__(self, master: LssMaster, name: str) -> None:
        self._master = master
        self._name = name

    def node_id(self) -> int | None:
        """Its node id; None: it has none. Raises LinkTimeout, DeviceError."""
        with self._told("tell its node id"):
            found = int(self._master.inquire_node_id())  # type: ignore[no-untyped-call]
        return None if found == UNCONFIGURED else found

    def set_node_id(self, node: int) -> None:
        """Set its node id, which it uses after a reset. Raises LinkTimeout, DeviceError."""
        with self._told(f"take node id {node}"):
            self._master.configure_node_id(node)  # type: ignore[no-untyped-call]

    def set_bitrate(self, bitrate: int) -> None:
        """Set its bit rate [bit/s], one of `BIT_TIMING`, which it uses when it is switched on again.

        Raises LinkTimeout, DeviceError.
        """
        with self._told(f"take {bitrate} bit/s"):
            self._master.configure_bit_timing(BIT_TIMING[bitrate])  # type: ignore[no-untyped-call]

    def save(self) -> None:
        """Let it keep both when it is switched off. Raises LinkTimeout, DeviceError."""
        with self._told("keep its settings"):
            self._master.store_configuration()  # type: ignore[no-untyped-call]

    @contextmanager
    def _told(self, what: str) -> Iterator[None]:
        try:
            yield
        except LssError as error:
            if str(error).startswith("LSS Error"):
                raise DeviceError(f"{self._name}: refuses to {what} ({error}); look at its manual") from None
            raise LinkTimeout(f"{self._name}: did not {what}: {error}; look at it before you go on") from None


@contextmanager
def selected(link: CanLink, address: LssAddress, timeout: float) -> Iterator[LssDevice]:
    """A context in which the device with this address alone takes settings; the link is open.

    At the end all devices leave LSS state configuration.

    Raises LinkTimeout: no such device answers within `timeout` [s]. LinkError: the bus failed.
    """
    master, name = link.network.lss, f"device {address} on {link.name}"
    master.RESPONSE_TIMEOUT = timeout
    master.responses = queue.Queue()
    link.subscribe(LssMaster.LSS_RX_COBID, master.on_message_received)
    try:
        try:
            found = master.send_switch_state_selective(*astuple(address))  # type: ignore[no-untyped-call]
        except LssError:
            found = False
        if not found:
            raise LinkTimeout(
                f"{name} does not answer; compare all four numbers with 1018h (palpate bus scan shows them), and see "
                "that it has LSS"
            )
        yield LssDevice(master, name)
    finally:
        link.network.unsubscribe(LssMaster.LSS_RX_COBID, master.on_message_received)
        _leave(link, master)


def _leave(link: CanLink, master: LssMaster) -> None:
    try:
        master.send_switch_state_global(LssMaster.WAITING_STATE)  # type: ignore[no-untyped-call]
    except Exception as error:  # each interface of python-can raises other types
        raise LinkError(f"CAN bus {link.name} failed: {error}; switch all devices off and on") from error
