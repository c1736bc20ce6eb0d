"""Driver of the shaker amplifier."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from palpate.drivers.clock import Clock
from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.kinds import AmplifierSettings
from palpate.instrument.contracts import shaker_amplifier
from palpate.instrument.contracts.contract import Value
from palpate.instrument.contracts.shaker_amplifier import SETTINGS
from palpate.instrument.errors import BenchInUse, DeviceError, SafetyError, SettingsLost, Unfed

HOTTEST = 85.0  # degC at which the driver stops; the amplifier itself trips at 90
ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_BUSY = 2, 3, 6  # Modbus exception codes
OFF = {"enable": "off"}


@dataclass(frozen=True, slots=True)
class AmplifierState:
    """State of the amplifier.

    Attributes:
        current: RMS output current [A].
        voltage: RMS output voltage [V].
        temperature: temperature of the heat sink [°C].
        faults: names of the present faults.
        faults_latched: names of the latched faults.
        enabled: whether the output stage is on.
    """

    current: float
    voltage: float
    temperature: float
    faults: frozenset[str]
    faults_latched: frozenset[str]
    enabled: bool


class ShakerAmplifier(ModbusDevice):
    """Our shaker amplifier, which a map does not describe: an owner gives it orders, and feeds its watchdog.

    If it is `owned`, only the program that has claimed it can write settings and feed its watchdog. Else it takes
    settings from any program, and any request feeds its watchdog.
    """

    contract = shaker_amplifier.CONTRACT

    @classmethod
    def at(cls, place: DevicePlace) -> Self:
        return cls(place.link, place.unit, place.clock, owned=place.settings.watchdog_fed_by == "owner")

    def __init__(self, link: ModbusLink, unit: int, clock: Clock, *, owned: bool = True) -> None:
        super().__init__(link, unit, clock)
        self.owned = owned
        self._token = 0
        self._counters = {False: 0, True: 0}  # counter of the signs of life (False), and of the orders (True)
        self._turn = threading.Lock()  # heartbeat and driving thread send in turns, so that counters rise on the wire

    def claim(self) -> bool:
        """Become or stay the owner. Returns False if another program owns it and has fed the watchdog in time.

        Raises:
            DeviceError: the amplifier knows no owners.
            LinkError: it does not answer.
        """
        if not self.owned:
            return True
        if self._token:
            try:
                self.feed()
                return True
            except (BenchInUse, SettingsLost):
                self._token = 0
        try:
            self._token, self._counters = int(self.get("ticket")), {False: 0, True: 0}
        except DeviceError as error:
            if error.code != ILLEGAL_ADDRESS:
                raise
            raise DeviceError(
                f"{self.name}: has no owners, so whoever reads it keeps its output on though this program has died; "
                'if that cannot be helped, write watchdog_fed_by = "any request" in its section of the bench file'
            ) from None
        patience, self._timing["busy"] = self._timing["busy"], 0.0  # so it answers to all but the owner: asked later
        try:
            self.feed()
        except BenchInUse:
            self._token = 0
            return False
        finally:
            self._timing["busy"] = patience
        return True

    def feed(self) -> None:
        """Feed the watchdog; without a confirmation it is sent a second time, which does no harm.

        Raises:
            BenchInUse: another program has claimed the amplifier.
            SettingsLost: the amplifier has no owner, because it was switched off.
            LinkError, DeviceError: it does not answer.
        """
        self._asked(self.live)

    def live(self) -> None:
        """Feed the watchdog with a single attempt. Raises as `feed` does."""
        if self._token:
            self._told(lambda: self._as_owner({}))
        else:
            self._told(lambda: self._read(("status",)))

    def release(self) -> None:
        """Switch the output off and give the ownership up. Raises LinkError, DeviceError."""
        token, self._token = self._token, 0
        if token:
            self.set(release=token)

    def _write(self, start: int, registers: list[int], values: Mapping[str, Value]) -> bool:
        if not self._token or not values.keys() <= SETTINGS.keys() or values == OFF:
            return super()._write(start, registers, values)
        confirmed = True
        for name, register in zip(sorted(values, key=SETTINGS.__getitem__), registers, strict=True):
            confirmed &= self._as_owner({"order": name, "order_value": register}, {name: values[name]})
        return confirmed

    def _as_owner(self, order: Mapping[str, Value], meant: Mapping[str, Value] | None = None) -> bool:
        """Write token and counter, followed by an `order`; errors name the setting `meant` by the order.

        Returns whether the write is confirmed, or else acknowledged.
        """
        with self._turn:
            self._counters[bool(order)] += 1
            block = {"token": self._token, "counter": self._counters[bool(order)], **order}
            data = b"".join(self.contract.encode(name, value) for name, value in block.items())
            registers = [int.from_bytes(data[i : i + 2], "big") for i in range(0, len(data), 2)]
            try:
                return super()._write(self.contract["token"].address, registers, meant or block)
            except DeviceError as error:
                if error.code == DEVICE_BUSY:
                    raise BenchInUse(
                        f"{self.name}: belongs to another program, which feeds its watchdog; wait for that to end, or "
                        "look for who else knows its address"
                    ) from None
                if error.code == ILLEGAL_VALUE:
                    raise SettingsLost(f"{self.name}: does not know this program any more; look at it") from None
                raise

    def set_up(self, settings: AmplifierSettings, watchdog: float) -> None:
        """As for every device. A latched fault of the watchdog is cleared, because every killed run leaves it.

        Raises SafetyError: the amplifier has tripped on another fault.
        """
        if self.read().faults_latched == {"watchdog"}:
            self.clear_faults()
        self.check()
        self.configure(settings.gain, settings.current_limit, watchdog)

    def configure(self, gain: float, current_limit: float, watchdog: float) -> None:
        """Set the voltage gain [V/V], the peak current at which it trips [A], and the watchdog's time-out [s]."""
        self.set(gain=gain, current_limit=current_limit)
        self.set(watchdog=watchdog)

    def enable(self) -> None:
        """Switch the output stage on. Raises DeviceError: a fault is latched."""
        self.set(enable="on")

    def disable(self) -> None:
        """Switch the output stage off."""
        self.set(enable="off")

    def clear_faults(self) -> None:
        """Clear the latched faults whose cause is gone."""
        self.set(clear_faults=1)

    def read(self) -> AmplifierState:
        """The present state. Raises LinkError, LinkTimeout, DeviceError."""
        current, voltage, temperature, faults, latched, status = self.get_many(
            "output_current", "output_voltage", "temperature", "faults", "faults_latched", "status"
        )
        return AmplifierState(
            current,
            voltage,
            temperature,
            self.contract.set_bits("faults", faults),
            self.contract.set_bits("faults_latched", latched),
            "enabled" in self.contract.set_bits("status", status),
        )

    def check(self) -> AmplifierState:
        """The present state, if it is safe.

        Raises:
            SafetyError: a fault is latched, and the output is off; or the current limit is passed, or the heat sink is
                within 5 K of the temperature at which the device trips.
        """
        state = self.read()
        if state.faults_latched:
            what = f"{self.name}: tripped on {', '.join(sorted(state.faults_latched))}; the output is off"
            if state.faults_latched == {"watchdog"}:
                raise Unfed(
                    what,
                    "It heard nothing of this program for too long: was that stopped (Ctrl-Z), did this machine sleep, "
                    "was a cable out? The next run clears the fault",
                )
            raise SafetyError(f"{what}. Remove the cause, then clear the faults")
        limit = float(self._settings.get("current_limit", math.inf))
        if state.temperature > HOTTEST or math.sqrt(2) * state.current > limit:
            raise SafetyError(
                f"{self.name}: heat sink at {state.temperature:g} degC, {math.sqrt(2) * state.current:.3g} A peak; "
                f"limits are {HOTTEST:g} degC and {limit:g} A. Outputs go off; let it cool, or ask for smaller loads"
            )
        return state
