"""Twins of exciters: signal generator and shaker amplifier, and a drive, whose torque or force shakes the stack."""

from __future__ import annotations

import math
import secrets
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

import numpy as np

from palpate.instrument.bench.role_maps import WATCHDOG, ExciterMap
from palpate.instrument.contracts.contract import Field, Pdo
from palpate.instrument.contracts.own import FAULTS, LARGEST_PEAK, SHAKER_AMPLIFIER, SIGNAL_GENERATOR
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.devices.positioner import OF_THE_STATE, DriveState
from palpate.simulators.devices.twin import CanopenTwin
from palpate.simulators.linear.periodic import HERTZ, SECOND, Periodic, sine
from palpate.simulators.wire.device import (
    DEVICE_BUSY,
    DEVICE_FAILURE,
    ILLEGAL_VALUE,
    Refused,
    SimulatedDevice,
    SimulatedPlace,
)

# --- the signal generator ------------------------------------------------------------------------------


HARMONICS = 25  # order of the highest harmonic of a square or triangle wave
FREQUENCY_STEPS = 1000  # steps per hertz: the resolution is 1 mHz


class SimulatedSignalGenerator(SimulatedDevice):
    """The signal generator. Calls `changed` when its output may have changed."""

    contract = SIGNAL_GENERATOR

    @classmethod
    def at(cls, place: SimulatedPlace) -> Self:
        return cls(place.clock, place.serial, lambda: place.find("amplifier").input_changed())

    def __init__(self, clock: VirtualClock, serial: str, changed: Callable[[], None]) -> None:
        super().__init__(clock, serial)
        self._changed = changed
        self._waveform = self._formed(start_phase=0)

    def write(self, values: dict[str, float]) -> None:
        new = {**self.settings, **values}
        if new["amplitude"] + abs(new["offset"]) > LARGEST_PEAK:
            self.settings["error"] = self.contract["error"].choices["amplitude_plus_offset"]
            raise Refused(ILLEGAL_VALUE)
        now = self.clock.now_ns()
        phase = 0 if values.get("phase_reset") else int(self._waveform.phase(np.array([now]))[0])
        self.settings = {**new, "phase_reset": 0.0, "error": 0.0, "writes": new["writes"] + 1}
        self._waveform = self._formed(phase)
        self._changed()

    def reset(self) -> None:
        super().reset()
        self.settings["writes"] = 0.0

    def out_of_range(self) -> None:
        self.settings["error"] = self.contract["error"].choices["range"]

    def read(self, name: str) -> float:
        if name == "status":
            return self.settings["output"]  # bit 0
        return super().read(name)

    def voltage(self) -> Periodic:
        """Output voltage."""
        return self._waveform if self.settings["output"] else self._waveform.scaled(0.0)

    def _formed(self, start_phase: int) -> Periodic:
        """The waveform of the present settings, from now on."""
        s = self.settings
        k = np.arange(1, HARMONICS + 1, 2)
        match self.contract.choice("waveform", s["waveform"]):
            case "square":
                sines = 4 / (np.pi * k)
            case "triangle":
                sines = 8 / (np.pi * k) ** 2 * np.where(k % 4 == 1, 1, -1)
            case _:
                k, sines = np.array([1]), np.array([1.0])
        return Periodic(
            s["offset"],
            round(s["frequency"] * FREQUENCY_STEPS) * (HERTZ // FREQUENCY_STEPS),
            self.clock.now_ns(),
            start_phase,
            k,
            (-1j * s["amplitude"] * sines).astype(complex),
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

    contract = SHAKER_AMPLIFIER

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


# --- a drive that follows set-points -------------------------------------------------------------------


RATED = 5.0  # A, coil current at the rated torque or force [A]
NODE_BITS, NODES = 16, 0x7F
QUICK_STOP = 6  # 605Ah: it brakes and stays in the state of a quick stop, as an EPOS4 comes from its maker


class SimulatedStreamedExciter(CanopenTwin):
    """A drive without a sine of its own; its current controller is taken as ideal.

    What it puts out between two set-points is the last one, so a stream is a staircase. Of this it has the mean, the
    sine, and the two strongest of the lines that the steps make.
    """

    def __init__(self, place: SimulatedPlace) -> None:
        self._map = place.kind.table(ExciterMap)
        self._heard_ns = NEVER  # the last heartbeat of its master; NEVER: it watches none
        self._stream: list[float] = []  # the set-points that come over and over [%]
        self._step_ns = 0
        self._begun_ns = 0
        super().__init__(place)
        place.clock.add(self)

    def reset(self) -> None:
        """Return to the state after power-on. The set-points still come."""
        super().reset()
        self._state = DriveState()
        self._heard_ns = NEVER
        self._changed()

    # --- what it is told -----------------------------------------------------------------------------------

    def write(self, field: Field, value: float) -> None:
        """Store what a client writes; a controlword moves the state machine."""
        self.settings[field.name] = value
        for command in self.contract.commands:
            if command.field == field.name:
                self._state.control(int(value), QUICK_STOP)
                break
        if field.name == WATCHDOG:
            self._heard_ns = NEVER  # it watches from the next heartbeat on
        self._changed()

    def receive_cycle(self, pdo: Pdo, values: Sequence[Mapping[str, float]], period_ns: int) -> None:
        if pdo.name != self._map.stream:
            return
        self.stop()
        (name,) = pdo.fields
        self._stream = [each[name] for each in values]
        self._step_ns, self._begun_ns = period_ns, self.clock.now_ns()
        self._changed()

    def start(self) -> None:
        self._changed()

    def stop(self) -> None:
        """Keep the set-point of this moment: it gets no more."""
        if self._stream:
            number = (self.clock.now_ns() - self._begun_ns) // self._step_ns % len(self._stream)
            (name,) = self.contract.taken(self._map.stream).fields
            self.settings[name] = self._stream[number]
        self._changed()

    def heard(self, node_id: int) -> None:
        raw = int(self.contract.raw(WATCHDOG, self.settings[WATCHDOG]))
        if node_id == raw >> NODE_BITS & NODES and self.settings[WATCHDOG]:
            self._heard_ns = self.clock.now_ns()

    def read(self, field: Field) -> Any:
        for command in self.contract.commands:
            if command.done is not None and command.done.field == field.name:
                return int(self.settings[field.name]) & ~OF_THE_STATE | self._state.bits
        return super().read(field)

    # --- what it does by itself ----------------------------------------------------------------------------

    def next_event_ns(self) -> int:
        """The time at which its master has been silent for too long."""
        if self._heard_ns == NEVER:
            return NEVER
        return self._heard_ns + round(self.speed * self.settings[WATCHDOG] * SECOND)

    def advance(self, start_ns: int, end_ns: int) -> None:
        if end_ns >= self.next_event_ns():
            self._heard_ns = NEVER
            self._fail(self._map.lost)

    def trip(self, fault: str) -> None:
        """Go to the state of a fault."""
        self._fail(0x2310)  # continuous over current

    def _fail(self, error: int) -> None:
        self._state.fail()
        self.settings[self._map.error] = float(error)
        self._changed()
        self.emergency(error)

    # --- what it puts out ----------------------------------------------------------------------------------

    @property
    def driving(self) -> bool:
        """Whether its output is on, in its mode."""
        mode = all(self.settings[name] == self._number(name, value) for name, value in self._map.set_up.items())
        return mode and self._state.enabled

    def _number(self, name: str, value: Any) -> float:
        return float(self.contract[name].choices[value]) if isinstance(value, str) else value

    def _changed(self) -> None:
        self.rig.set_voltage(self._voltage())

    def _voltage(self) -> Periodic:
        """Voltage at the coil now, as if its resistance alone took the current [V]."""
        before, now = self.rig.coil_voltage(), self.clock.now_ns()
        volts_per_percent = RATED * self.rig.scene.rig.coil_resistance / 100
        if not self.driving:
            return sine(before.frequency / HERTZ, 0.0, now, before)
        if not self._stream or self.wire is None or not self.wire.operational:
            (name,) = self.contract.taken(self._map.stream).fields
            return Periodic(
                volts_per_percent * self.settings[name], before.frequency, now, 0, np.array([1]), np.zeros(1, complex)
            )
        return staircase(self._stream, self._step_ns, self._begun_ns).restarted(now).scaled(volts_per_percent)


def staircase(steps: Sequence[float], step_ns: int, begun_ns: int) -> Periodic:
    """A staircase whose steps come over and over: its mean, its strongest sine, and the strongest lines of the steps.

    A list of several periods has lines of the steps that are no harmonics of its sine; they are left out.
    """
    values = np.asarray(steps)
    count = len(values)
    spectrum = np.fft.rfft(values) / count
    periods = 1 + int(np.argmax(np.abs(spectrum[1:]))) if count > 2 else 1
    orders = np.array([1, count - 1, count + 1]) if periods == 1 else np.array([periods])
    lines = np.exp(-2j * np.pi * np.outer(orders, np.arange(count)) / count) @ values / count
    held = np.sinc(orders / count) * np.exp(-1j * np.pi * orders / count)
    frequency = round(periods * HERTZ * SECOND / (count * step_ns))
    return Periodic(float(values.mean()), frequency, begun_ns, 0, orders // periods, 2 * lines * held)
