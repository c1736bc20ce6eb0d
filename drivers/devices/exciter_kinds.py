"""The exciters that there are: a generator with an amplifier, or one device that is both, such as a drive.

A drive has no sine of its own, so the bus sends it a stream of set-points of its torque or force. They take effect when
they arrive, and the kernel sends them on time, even while this program computes. It would do so as well while this
program hangs, and a drive holds its last set-point when nobody sends any more. So the drive watches the heartbeat of
this program, which no kernel sends, and switches off when it stays away.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Self

from palpate.drivers.devices.amplifier import AmplifierState
from palpate.drivers.devices.canopen_device import CanopenDevice
from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.exciter import Exciter
from palpate.instrument.bench.role_maps.exciter import WATCHDOG, ExciterMap
from palpate.instrument.contracts.contract import Pdo
from palpate.instrument.contracts.pdo import MOST_CYCLIC
from palpate.instrument.errors import DeviceError, LinkError, RangeError, SafetyError, Unfed

QUIET = 10.0, 0.0  # Hz, V: a sine with no amplitude


class Amplified(Exciter):
    """An exciter of a generator and an amplifier."""

    def __init__(self, source: Any, amplifier: Any) -> None:
        """Make an exciter of two devices.

        Args:
            source: the generator, with `sine` and `output`.
            amplifier: the amplifier, with `enable`, `disable` and `check`. With a watchdog it is the `WatchdogGuard`,
                too.
        """
        self._source, self._amplifier = source, amplifier
        self.guard = amplifier if amplifier.contract.has("watchdog") else None

    @property
    def members(self) -> tuple[Any, ...]:
        return self._amplifier, self._source

    def sine(self, frequency: float, amplitude: float) -> None:
        self._source.sine(frequency, amplitude)

    def drive(self) -> None:
        self._source.sine(*QUIET)
        self._amplifier.enable()
        self._source.output(True)

    def rest(self) -> None:
        self._source.sine(*QUIET)
        self._source.output(False)
        self._amplifier.disable()

    def halt(self) -> None:
        self._amplifier.disable()

    def quiet(self) -> None:
        self._source.output(False)
        self._source.sine(*QUIET)

    def means(self) -> list[Callable[[], object]]:
        return [self._amplifier.disable, lambda: self._source.output(False), lambda: self._source.sine(*QUIET)]

    def check(self) -> AmplifierState:
        state: AmplifierState = self._amplifier.check()
        return state

    def effort(self) -> float:
        """Peak of the output current [A]."""
        return math.sqrt(2) * self.check().current

    def effort_limit(self) -> float:
        """Peak output current at which the amplifier trips [A]."""
        limit: float = self._amplifier.get("current_limit")
        return limit


# --- A sine as a list of set-points that a bus sends over and over -------------------------------------

FEWEST = 20  # set-points of a period
CLOSEST = 2e-5  # greatest error of the frequency, relative
LONGEST_US = 1_000_000  # between two set-points


@dataclass(frozen=True)
class SetPointGrid:
    """Times of the set-points of some whole periods: `count` of them, `step_us` apart, which are `periods`."""

    count: int
    step_us: int
    periods: int

    @property
    def length_ns(self) -> int:
        """Time that the list takes."""
        return 1000 * self.count * self.step_us

    @property
    def frequency(self) -> float:
        """Frequency of the sine [Hz]."""
        return 1e9 * self.periods / self.length_ns

    def sine(self, peak: float) -> list[float]:
        """The set-points of a sine."""
        return [peak * math.sin(2 * math.pi * self.periods * number / self.count) for number in range(self.count)]


def grid(frequency: float, fastest: float, who: str) -> SetPointGrid:
    """The times of set-points whose sine is closest to a frequency.

    Args:
        frequency: frequency of the sine [Hz].
        fastest: shortest time between two set-points [s].
        who: name of the device, for the message.

    Raises RangeError: the frequency is too high or too low, or no list has it.
    """
    highest, lowest = 1 / (FEWEST * fastest), 1e6 / (MOST_CYCLIC * LONGEST_US)
    if not lowest <= frequency <= highest:
        raise RangeError(
            f"{who}: frequency = {frequency:g} Hz is outside {lowest:.3g} to {highest:g} Hz, which {FEWEST} to "
            f"{MOST_CYCLIC} set-points of a period reach, {1e3 * fastest:g} ms or more apart; give one inside"
        )
    best = min(_lists(frequency, fastest), key=lambda each: abs(each.frequency - frequency))
    if abs(best.frequency - frequency) > CLOSEST * frequency:
        raise RangeError(
            f"{who}: frequency = {frequency:.10g} Hz: no list of set-points, which come every whole microsecond, has "
            f"it; the nearest has {best.frequency:.10g} Hz"
        )
    return best


def _lists(frequency: float, fastest: float) -> Iterator[SetPointGrid]:
    """All lists near a frequency, those of few periods first, and of these the finest first."""
    for periods in range(1, MOST_CYCLIC // FEWEST + 1):
        for count in range(MOST_CYCLIC, FEWEST * periods - 1, -1):
            step_us = round(1e6 * periods / (frequency * count))
            if fastest * (1 - 1e-9) <= 1e-6 * step_us <= 1e-6 * LONGEST_US:
                yield SetPointGrid(count, step_us, periods)


# --- a drive that follows set-points -------------------------------------------------------------------

NODE_BITS = 16  # bits of 1016h below those of the node id that is watched
OFF = 0.0


class StreamedExciter(CanopenDevice, Exciter):
    """A drive that follows set-points, by its map's table `[role.exciter]`.

    Its amplitude is that of an input of 10 V; see `ExciterSettings.full_scale`.
    """

    owned = True  # no request feeds its watchdog, only a heartbeat of this program's node id
    unit = "%"
    _map: ExciterMap
    _full_scale: float  # %, peak of the effort at the greatest amplitude
    _stream: Pdo  # that holds a set-point
    _master: int  # node id of this program

    @classmethod
    def at(cls, place: DevicePlace) -> Self:
        """Make the driver of a drive whose kind has a table for the role."""
        made = super().at(place)
        assert place.kind is not None
        made._map, made._full_scale = place.kind.table(ExciterMap), 100 * place.settings.full_scale
        made._stream = made.contract.taken(made._map.stream)
        made.orders = made.orders | frozenset(made._stream.fields)
        made._master = int(made.contract.raw(WATCHDOG, OFF)) >> NODE_BITS
        made.guard = made
        return made

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._timeout = OFF
        self._mine = False  # whether this program owns it
        self._enabled = False  # whether it should be driving
        self._grid: SetPointGrid | None = None  # of the set-points that the bus sends now; None: it sends none
        self._begun_ns = 0
        self._peak = 0.0  # %

    def connect(self) -> None:
        """As every node; raises LinkError as well if its bus cannot send set-points on time."""
        self.link.check_cyclic()
        super().connect()

    def set_up(self, settings: Any, watchdog: float) -> None:
        self._timeout = watchdog
        self.give(**self._map.set_up)

    def check_section(self, settings: Any, frequency: float) -> None:
        """As for every device: its map tells all that limits its frequency."""
        self.check_frequency(frequency)

    def check_frequency(self, frequency: float) -> None:
        """Raises RangeError: no list of set-points has this frequency [Hz]."""
        grid(frequency, self._map.fastest, self.name)

    # --- what switches it off ------------------------------------------------------------------------------

    def claim(self) -> bool:
        """Become or stay the owner; a drive that another program has enabled is not free until its watchdog acts."""
        if not self._mine and self._drives():
            if self.held(WATCHDOG) <= 0:
                raise DeviceError(
                    f"{self.name}: is switched on, and watches nobody's heartbeat; end the program that uses it, or "
                    "switch the drive off",
                    device=self.name,
                )
            return False
        self._mine = True
        return True

    def release(self) -> None:
        """Switch it off, and own it no longer."""
        self._switch_off()
        self._mine = False

    def feed(self) -> None:
        """Let the drive hear a heartbeat; there is no answer."""
        self._told(self.live)

    def live(self) -> None:
        """Let the drive hear a heartbeat, from whatever thread."""
        self.link.beat(self._master)

    # --- the role ------------------------------------------------------------------------------------------

    def sine(self, frequency: float, amplitude: float) -> None:
        """Drive with a sine. A running one ends where it crosses zero upwards, where the new one begins.

        Raises RangeError: the amplitude is above 10 V, or the bus cannot send a sine of this frequency.
        """
        if not 0 <= amplitude <= self.largest:
            raise RangeError(f"{self.name}: amplitude = {amplitude:g} V is outside 0 to {self.largest:g} V")
        new = grid(frequency, self._map.fastest, self.name)
        peak = self._full_scale * amplitude / self.largest
        (name,) = self._stream.fields
        frames = [self.contract.packed(self._stream, {name: value}) for value in new.sine(peak)]
        if self._grid is not None:
            left = -(self.clock.now_ns() - self._begun_ns) % self._grid.length_ns
            self.clock.wait(1e-9 * left)
        if not peak:
            self._still()
            return
        self._told(self.start)  # again, because another program may have told the node another state meanwhile
        self._told(lambda: self.link.begin_cycle(self._stream.cob_id(self.id), frames, new.step_us))
        self._grid, self._begun_ns, self._peak = new, self.clock.now_ns(), peak
        self._asked(self._barrier)  # the drive has got what was sent before

    def drive(self) -> None:
        """Switch the output on, at a set-point of zero. Raises DeviceError: a fault is latched."""
        self._clear_loss()
        self.start()
        self._still()
        self.live()  # from its first heartbeat on it is watched
        self.set(WATCHDOG, self._timeout)
        self.live()
        self.command(self._map.enable)
        self._enabled = True

    def rest(self) -> None:
        """Bring the set-point to zero, switch the output off, and let it watch nothing any more."""
        self._enabled = False
        self._still()
        self._switch_off()
        self.set(WATCHDOG, OFF)

    def halt(self) -> None:
        self._switch_off()

    def means(self) -> list[Any]:
        return [self._switch_off, self._still]

    def check(self) -> None:
        """Raises SafetyError: it has a fault, or has switched itself off."""
        field, bit = self._map.fault
        if bit in self.contract.set_bits(field, self.get(field)):
            error = self.held(self._map.error)
            if int(error) == self._map.lost:
                raise Unfed(
                    f"{self.name}: did not hear this program, and has switched its output off",
                    "Find the cause, and run again",
                )
            raise SafetyError(
                f"{self.name}: has the fault 0x{int(error):04X}, and has switched its output off; find the cause, and "
                "run again"
            )
        if self._enabled and not self._drives():
            raise SafetyError(f"{self.name}: its output was switched off; find out by whom, and run again")

    def effort(self) -> float:
        """Present peak of the set-points [%]."""
        self.check()
        return self._peak

    def effort_limit(self) -> float:
        return self._full_scale

    def restore(self) -> None:
        super().restore()
        self._grid = None  # a drive that has started anew follows set-points again after `drive`

    # --- parts ---------------------------------------------------------------------------------------------

    def _drives(self) -> bool:
        """Whether its output is on. Raises LinkError, DeviceError."""
        done = self.contract.command(self._map.enable).done
        assert done is not None
        return done.holds(self.contract[done.field].to_raw(self.held(done.field)))

    def _clear_loss(self) -> None:
        """Clear the fault that a program was no longer heard, which holds after that program was killed.

        Raises DeviceError: another fault is latched.
        """
        field, bit = self._map.fault
        if bit not in self.contract.set_bits(field, self.get(field)):
            return
        if (error := int(self.held(self._map.error))) != self._map.lost:
            raise DeviceError(
                f"{self.name}: has the fault 0x{error:04X}; find its cause, then switch the drive off and on",
                device=self.name,
            )
        self.command(self._map.reset)

    def _still(self) -> None:
        """End the stream, and send a set-point of zero once."""
        self._grid, self._peak = None, 0.0
        try:
            self.link.end_cycle(self._stream.cob_id(self.id))
        finally:
            self.send(self._stream.name, **dict.fromkeys(self._stream.fields, 0.0))
        self._asked(self._barrier)

    def _switch_off(self) -> None:
        """Switch the output off. An order that is not confirmed is given once more: it cannot do harm.

        A node that another program has stopped (NMT) answers nothing until it is told another state.
        """
        try:
            self.command(self._map.disable)
        except LinkError as error:
            self.noticed(f"{error}; switched off once more")
            with suppress(LinkError):
                self.stop()
            self.command(self._map.disable)
