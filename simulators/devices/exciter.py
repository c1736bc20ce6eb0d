"""The twin of a drive that follows set-points: its torque or force shakes the stack, while it hears its master."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from palpate.instrument.bench.role_maps.exciter import WATCHDOG, ExciterMap
from palpate.instrument.contracts.contract import Field, Pdo
from palpate.simulators.clock import NEVER
from palpate.simulators.devices.positioner import OF_THE_STATE, DriveState
from palpate.simulators.devices.twin import CanopenTwin
from palpate.simulators.linear.periodic import HERTZ, SECOND, Periodic, sine
from palpate.simulators.wire.device import SimulatedPlace

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
