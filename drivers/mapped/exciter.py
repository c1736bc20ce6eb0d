"""A drive as exciter: it has no sine of its own, so the bus sends it a stream of set-points of its torque or force.

The set-points take effect when they arrive, and the kernel sends them on time, even while this program computes. It
would do so as well while this program hangs, and a drive holds its last set-point when nobody sends any more. So the
drive watches the heartbeat of this program, which no kernel sends, and switches off when it stays away.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Self

from palpate.drivers.devices.canopen_device import CanopenDevice
from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.exciter import Exciter
from palpate.drivers.mapped.set_points import SetPointGrid, grid
from palpate.instrument.bench.role_maps.exciter import WATCHDOG, ExciterMap
from palpate.instrument.contracts.contract import Pdo
from palpate.instrument.errors import DeviceError, LinkError, RangeError, SafetyError, Unfed

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
