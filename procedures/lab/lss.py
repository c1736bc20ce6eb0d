"""Gives a CANopen device a node id or a bit rate (LSS), after a person has agreed."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Self

from palpate.drivers.bench_lock import BenchLock
from palpate.drivers.links.can import CanLink
from palpate.drivers.links.lss import BIT_TIMING, LssAddress, selected
from palpate.instrument.bench.links import CanBus, Link
from palpate.instrument.config import check
from palpate.instrument.errors import BenchError, DeviceError, LinkTimeout, RangeError, UsageError

DEVICE_TYPE = 0x1000


@dataclass
class Change:
    """A change of a device's node id or bit rate.

    Attributes:
        bus: the bus, at the bit rate that it has now.
        address: the device.
        node: node id to set; None: it stays.
        bitrate: bit rate to set [bit/s]; None: it stays.
        save: whether the device keeps both when it is switched off.
    """

    bus: CanBus
    address: LssAddress
    node: int | None
    bitrate: int | None
    save: bool
    links: dict[str, Link] = field(init=False)

    def __post_init__(self) -> None:
        """Raises UsageError, RangeError: there is nothing to set, or it cannot be set so."""
        if self.node is None and self.bitrate is None:
            raise UsageError("nothing to set; give --node or --to-bitrate")
        if self.node is not None and not 1 <= self.node <= 127:
            raise RangeError(f"--node {self.node} is outside 1 to 127; give one inside")
        if self.bitrate is not None and self.bitrate not in BIT_TIMING:
            raise RangeError(f"--to-bitrate {self.bitrate}: LSS knows {', '.join(map(str, BIT_TIMING))}")
        if self.bitrate is not None and not self.save:
            raise UsageError(
                "--to-bitrate: a device takes a new bit rate when it is switched on again, so it has to keep it: give "
                "--save, too"
            )
        self.links = {"can": self.bus}

    @classmethod
    def asked(
        cls, *, can: str, at: int, address: LssAddress, node: int | None, bitrate: int | None, save: bool
    ) -> Self:
        """Read the arguments of the command. Raises UsageError, RangeError, ConfigError."""
        interface, _, channel = can.partition(":")
        bus = check({"interface": interface, "channel": channel, "bitrate": at}, CanBus, f"--can {can}")
        return cls(bus, address, node, bitrate, save)

    def __str__(self) -> str:
        """What will be done, for the person who agrees to it."""
        parts = [f"node id {self.node}"] if self.node is not None else []
        parts += [f"{self.bitrate} bit/s"] if self.bitrate is not None else []
        kept = "and keeps it when it is switched off" if self.save else "until it is switched off"
        return f"device {self.address} on {self.bus.interface}:{self.bus.channel} gets {' and '.join(parts)}, {kept}"

    def carry_out(self, agreed: Callable[[str], object]) -> int | None:
        """Make the change; returns the node id that the device had, None: it had none.

        Args:
            agreed: called with what will be done before anything is written; raises where a person does not agree.

        Raises BenchError: the device does not answer or refuses, or the node id is taken; UsageError.
        """
        link = CanLink(self.bus)
        with BenchLock(self):
            link.open()
            try:
                with selected(link, self.address, self.bus.timeout) as device:
                    before = device.node_id()
                if self.node is not None and self.node != before:
                    self._check_free(link, self.node)
                agreed(f"{self} (it has {'no node id' if before is None else f'node id {before}'} now)")
                with selected(link, self.address, self.bus.timeout) as device:
                    if self.node is not None:
                        device.set_node_id(self.node)
                    if self.bitrate is not None:
                        device.set_bitrate(self.bitrate)
                    if self.save:
                        device.save()
                return before
            finally:
                with suppress(BenchError):
                    link.close()

    def _check_free(self, link: CanLink, node: int) -> None:
        """Raises DeviceError: another device answers as this node."""
        try:
            with suppress(DeviceError):  # a node that refuses answers, too
                link.upload(f"node {node}", link.add_node(node), DEVICE_TYPE, 0)
        except LinkTimeout:
            return
        raise DeviceError(f"node {node} answers already on {link.name}; give another --node, nothing was written")
