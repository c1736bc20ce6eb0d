"""Driver of the sample changer."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from palpate.drivers.clock import Clock
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.contracts.own import PLACES, SAMPLE_CHANGER
from palpate.instrument.errors import DeviceError, SampleError, UnknownName

POLL = 0.5  # s
TIMEOUT = 120.0  # s
STATE = ("mounted", "exchanges", "status")


@dataclass(frozen=True, slots=True)
class ChangerState:
    """State of the sample changer.

    Attributes:
        sample: name on the tag of the sample under the probe; empty: there is none.
        exchanges: how often the sample under the probe has changed so far.
        moving: whether it is being changed now.
    """

    sample: str
    exchanges: int
    moving: bool


class ModbusSampleChanger(ModbusDevice):
    """Our sample changer, which mounts samples by name: the only device of its role, so no map describes one.

    A mounted sample must stay untouched until the next order.
    """

    contract = SAMPLE_CHANGER
    orders = frozenset({"order"})

    def __init__(self, link: ModbusLink, unit: int, clock: Clock) -> None:
        super().__init__(link, unit, clock)
        self._laid: ChangerState | None = None
        self.samples: tuple[str, ...] = ()

    def connect(self) -> None:
        """As for every device; also reads the names of its samples, and waits until it stands.

        A run that was killed may have left it moving.
        """
        super().connect()
        names = (self.get_text(f"place_{number}") for number in range(1, PLACES + 1))
        self.samples = tuple(name for name in names if name)
        self._standing(TIMEOUT)

    def check_holds(self, names: Iterable[str]) -> None:
        """Refuse names of samples that no place holds. Raises UnknownName, which lists those that it holds."""
        for name in names:
            if name not in self.samples:
                raise UnknownName(f"sample of the {self.name}", name, self.samples)

    def mounted(self) -> ChangerState:
        """The present state. Raises LinkError, LinkTimeout, DeviceError."""
        return self._asked(self._mounted)

    def _mounted(self) -> ChangerState:
        name, exchanges, status = self._read(STATE)
        moving = "moving" in self.contract.set_bits("status", self._value("status", status))
        return ChangerState(self._text("mounted", name), int(self._value("exchanges", exchanges)), moving)

    def mount(self, name: str, timeout: float = TIMEOUT) -> None:
        """Mount a sample by its name under the probe, which must be at home, and wait until it is there.

        Raises:
            UnknownName, RangeError: no place holds the sample; nothing is sent.
            DeviceError: the changer refuses, needs longer than `timeout` [s], or has mounted another sample.
        """
        self.check_holds((name,))
        self._laid = None
        self._standing(timeout)  # another client's order may be under way
        if not self.set(order=name):
            self._await_start(lambda: (now := self.mounted()).moving or now.sample == name)
        found = self._standing(timeout)
        if found.sample != name:
            raise DeviceError(f"{self.name}: has mounted {found.sample!r}, was ordered {name!r}; look at it")
        self._laid = found

    def _standing(self, timeout: float) -> ChangerState:
        """The state as soon as nothing moves. Raises DeviceError: it still moves after `timeout` [s]."""
        waited = 0.0
        while (found := self.mounted()).moving:
            if waited >= timeout:
                raise DeviceError(f"{self.name}: moves still after {timeout:g} s; look at it")
            self.clock.wait(POLL)
            waited += POLL
        return found

    def leave(self) -> None:
        """From now on a person may put anything under the probe."""
        self._laid = None

    def check(self) -> None:
        """See that what was laid by the last order lies there still, and was not away meanwhile.

        Raises:
            SampleError: it does not, or was. LinkError, LinkTimeout, DeviceError: it cannot be asked.
        """
        if self._laid is None:
            return
        found, laid = self.mounted(), self._laid
        if found != laid:
            now = (
                "moves" if found.moving else f"has {found.sample!r} mounted" if found.sample else "has nothing mounted"
            )
            raise SampleError(
                f"{self.name}: {now}, {laid.sample!r} was ordered; exchanged {found.exchanges - laid.exchanges} times "
                "since, by hand or by another client. Leave the samples alone and go on",
                device=self.name,
            )

    def differences(self) -> list[str]:
        """As for every device; also raises as `check` does, because a swapped sample cannot be restored."""
        self.check()
        return super().differences()
