"""Simulated shaker amplifier: gain, trip at the current limit, heating, a communication watchdog, and its owner."""

from __future__ import annotations

import math
import secrets
from collections import deque
from collections.abc import Callable, Mapping
from typing import Self

import numpy as np

from palpate.instrument.contracts import shaker_amplifier
from palpate.instrument.contracts.shaker_amplifier import FAULTS
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.linear.periodic import Periodic
from palpate.simulators.wire.device import (
    DEVICE_BUSY,
    DEVICE_FAILURE,
    ILLEGAL_VALUE,
    Refused,
    SimulatedDevice,
    SimulatedPlace,
)

# --- the client that alone may write settings, and that feeds the watchdog -----------------------------

TICKETS = 64  # number of unused tickets that stay valid: more than the clients that a server accepts
SPREAD = 2_654_435_761  # of tickets that anybody can guess: odd, so that none repeats, and they differ in many bits


class AmplifierOwner:
    """Keeps which client owns the amplifier: the one that has claimed it with a ticket, until it releases it.

    Attributes:
        token: the owner's ticket; 0: there is no owner.
        fed_ns: time of the last sign of life that fed the watchdog, on the bench's clock [ns].
    """

    def __init__(self) -> None:
        self.token = 0
        self.fed_ns = 0
        self._counters = {False: 0, True: 0}  # the last counter of a sign of life, and of an order (True)
        self._given = 0
        self._tickets: deque[int] = deque(maxlen=TICKETS)

    def ticket(self, *, secret: bool) -> int:
        """A new ticket, not 0. One that is not `secret` differs from all before it, and is the same in each run."""
        self._given += 1
        ticket = 1 + secrets.randbelow(2**32 - 1) if secret else self._given * SPREAD % 2**32
        self._tickets.append(ticket)
        return ticket

    def heard(self, values: Mapping[str, float], now_ns: int, lease_ns: int) -> None:
        """Handle a write with a token: a sign of life from the owner, or a claim with a new ticket.

        Args:
            values: the written fields, with the token.
            now_ns: the time on the bench's clock [ns].
            lease_ns: how long an owner counts as alive after its last sign of life [ns].

        Raises Refused: the counter is missing or not greater than the last; another owner is alive; the token is no
            valid ticket, or a used one.
        """
        if "counter" not in values or ("order" in values) != ("order_value" in values):
            raise Refused(ILLEGAL_VALUE)
        token, counter, series = int(values["token"]), int(values["counter"]), "order" in values
        if token != self.token:
            if self._alive(now_ns, lease_ns):
                raise Refused(DEVICE_BUSY)
            if token not in self._tickets:
                raise Refused(ILLEGAL_VALUE)
            self._tickets.remove(token)
            self.token, self._counters = token, {False: 0, True: 0}
        elif counter <= self._counters[series]:
            raise Refused(ILLEGAL_VALUE)
        self._counters[series], self.fed_ns = counter, now_ns

    def replaced(self, now_ns: int, lease_ns: int) -> None:
        """Handle a write without a token, which ends a dead owner's claim. Raises Refused: the owner is alive."""
        if self._alive(now_ns, lease_ns):
            raise Refused(DEVICE_BUSY)
        if self.token:
            self.token, self.fed_ns = 0, now_ns

    def release(self, token: float) -> None:
        """End the owner's claim. Raises Refused: the token is not the owner's."""
        if int(token) != self.token:
            raise Refused(DEVICE_BUSY)
        self.token = 0

    def forget(self) -> None:
        """Return to the state after power-on."""
        self.token = 0
        self._tickets.clear()

    def _alive(self, now_ns: int, lease_ns: int) -> bool:
        return bool(self.token) and now_ns < self.fed_ns + lease_ns


# --- the amplifier -------------------------------------------------------------------------------------

AMBIENT = 25.0  # degC [A]
THERMAL_RESISTANCE = 2.0  # K/W, warming for each watt in the coil [A]
THERMAL_TIME = 300.0  # s, time constant [A]
HOT = 90.0  # degC, at which the amplifier trips [A]
LONGEST_SILENCE = 60.0  # s, after which an owner counts as gone if the watchdog is off
OWNERS = {"counter", "order", "order_value"}  # fields that only an owner may write, together with its token
COOL = 80.0  # degC, below which the over-temperature fault ends [A]


class SimulatedShakerAmplifier(SimulatedDevice):
    """The shaker amplifier.

    Args:
        clock: the bench's clock.
        serial: the serial number.
        source: returns the input voltage.
        changed: called when the output may have changed.
        coil_resistance: resistance of the shaker's coil [ohm].
    """

    contract = shaker_amplifier.CONTRACT

    @classmethod
    def at(cls, place: SimulatedPlace) -> Self:
        """Make the amplifier between the device in the role of the source and the rig's coil."""
        rig = place.rig
        made = cls(
            place.clock,
            place.serial,
            lambda: place.find("source").voltage(),
            lambda: rig.set_voltage(made.voltage()),
            rig.scene.rig.coil_resistance,
        )
        return made

    def __init__(
        self,
        clock: VirtualClock,
        serial: str,
        source: Callable[[], Periodic],
        changed: Callable[[], None],
        coil_resistance: float,
    ) -> None:
        super().__init__(clock, serial)
        self._source = source
        self._changed = changed
        self._resistance = coil_resistance
        self._owner = AmplifierOwner()
        self._latched = 0
        self._rms = 0.0  # V, RMS of the output
        self._heated_from = self._heating_to = AMBIENT
        self._heated_ns = 0

    def voltage(self) -> Periodic:
        """Output voltage."""
        return self._source().scaled(self.settings["gain"] if self.settings["enable"] else 0.0)

    def input_changed(self) -> None:
        """Call it when the input or a setting has changed. Trips if the current is too high."""
        least, greatest = self.voltage().extremes()
        peak = max(-least, greatest) / self._resistance
        if not peak <= self.settings["current_limit"]:
            self._trip("over_current")
        self._power_changed()
        self._changed()

    def write(self, values: dict[str, float]) -> None:
        """Handle a write. Raises Refused.

        The owner may write any setting, other clients only while no owner is alive; anybody may switch the output off.
        """
        if "token" not in values and values.keys() & OWNERS:
            raise Refused(ILLEGAL_VALUE)
        now, lease_ns = self.clock.now_ns(), self._seconds_ns(self.settings["watchdog"] or LONGEST_SILENCE)
        if "token" in values:
            self._owner.heard(values, now, lease_ns)
            if order := self._order(values):
                self.turn(order)
        elif "release" in values:
            self._owner.release(values["release"])
            self.turn({"enable": 0.0})
        elif values != {"enable": 0.0}:
            self._owner.replaced(now, lease_ns)
            self.turn(values)
        else:
            self.turn(values)

    def _order(self, values: dict[str, float]) -> dict[str, float]:
        """The setting that the owner orders, by name; empty for a mere sign of life."""
        if "order" not in values:
            return {}
        name = self.contract.choice("order", values["order"])
        value = self.contract.decode(name, int(values["order_value"]).to_bytes(2, "big"))
        if not self.contract.allows(name, value):
            raise Refused(ILLEGAL_VALUE)
        return {name: value}

    def turn(self, values: dict[str, float]) -> None:
        if values.get("enable") and self._latched:
            raise Refused(DEVICE_FAILURE)
        if values.get("clear_faults"):
            self._latched = self._present()
        self.settings.update({**values, "clear_faults": 0.0})
        self.input_changed()

    def read(self, name: str) -> float:
        match name:
            case "output_current":
                return self._rms / self._resistance
            case "output_voltage":
                return self._rms
            case "temperature":
                return self._temperature()
            case "faults":
                return self._present()
            case "faults_latched":
                return self._latched
            case "status":
                return self.settings["enable"] + 2 * bool(self._owner.token)  # bits 0 and 1
            case "ticket":
                return self._owner.ticket(secret=self.clock.served)  # strangers reach a served bench
        return super().read(name)

    def requested(self) -> None:
        if not self._owner.token:
            self._owner.fed_ns = self.clock.now_ns()

    def next_event_ns(self) -> int:
        if not self.settings["enable"]:
            return NEVER
        return max(min(self._watchdog_ns(), self._hot_ns()), self.clock.now_ns() + 1)

    def advance(self, start_ns: int, end_ns: int) -> None:
        if self.settings["enable"] and end_ns >= min(self._watchdog_ns(), self._hot_ns()):
            self.trip("watchdog" if end_ns >= self._watchdog_ns() else "over_temperature")

    def trip(self, fault: str) -> None:
        """Latch a fault and switch the output off."""
        self._trip(fault)
        self._power_changed()
        self._changed()

    def reset(self) -> None:
        self._latched = 0
        self._owner.forget()
        super().reset()

    def _watchdog_ns(self) -> int:
        """Time at which the watchdog switches the output off unless it is fed [ns]."""
        timeout = self.settings["watchdog"]
        return self._owner.fed_ns + self._seconds_ns(timeout) if timeout else NEVER

    def _seconds_ns(self, seconds: float) -> int:
        """Seconds of the clients' clock in nanoseconds of this one."""
        return round(self.speed * seconds * 1e9)

    def _hot_ns(self) -> int:
        """Time at which the heat sink reaches its limit if nothing changes [ns]."""
        if self._heating_to <= HOT or self._heated_from >= HOT:
            return NEVER
        delay = THERMAL_TIME * math.log((self._heating_to - self._heated_from) / (self._heating_to - HOT))
        return self._heated_ns + math.ceil(delay * 1e9)

    def _present(self) -> int:
        fault = 1 << FAULTS["over_temperature"]
        return fault if self._temperature() >= (COOL if self._latched & fault else HOT) else 0

    def _trip(self, fault: str) -> None:
        self._latched |= 1 << FAULTS[fault]
        self.settings["enable"] = 0.0

    def _temperature(self) -> float:
        """Temperature now [degC], in closed form, so that it does not depend on how waits are divided."""
        elapsed = 1e-9 * (self.clock.now_ns() - self._heated_ns)
        return self._heating_to + (self._heated_from - self._heating_to) * math.exp(-elapsed / THERMAL_TIME)

    def _power_changed(self) -> None:
        self._heated_from, self._heated_ns = self._temperature(), self.clock.now_ns()
        voltage = self.voltage()
        self._rms = math.sqrt(voltage.mean**2 + float((np.abs(voltage.amplitude) ** 2).sum()) / 2)
        self._heating_to = AMBIENT + THERMAL_RESISTANCE * self._resistance * self.read("output_current") ** 2
