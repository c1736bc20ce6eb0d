"""The physical scene behind the devices: what force acts, and what the films and the bridge make of it.

Between two changes (a setting written, a sample mounted, a move ended) the drive is periodic and the chain
linear, so everything in such a segment is known in closed form at any time: nothing is stepped, and no
result depends on when it was asked for.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt

from instrument.calibration import STANDARD_GRAVITY
from instrument.load import Load
from instrument.models.response import Response, response
from instrument.sample import Sample
from simulators.clock import VirtualClock
from simulators.lti import Floats, Periodic, StateSpace, first_order_low_pass
from simulators.randomness import Stream
from simulators.scene import Scene

if TYPE_CHECKING:  # an effect's module is imported by the scene that calls for it, and only then
    from simulators.effects.charge_amplifier import ChargeAmplifier
    from simulators.effects.gain_scatter import GainScatter

HISTORY_NS = 12_000_000_000  # the indicator looks back 10 s at most
CONTACT_POINTS = 256  # samples of one period from which a force that loses contact is expanded
# Where contact is lost a sine or triangle is then 0.9 % of the drive's peak force off; the edges of a square
# ring by 14 % of it [M].
CONTACT_HARMONICS = 40


@dataclass(frozen=True)
class Segment:
    """A stretch without changes: the contact force, the films' gains and the states at its start.

    gains: (films,) V/N of contact force. film_state: (films, s). bridge_state: (1,) N.
    """

    start_ns: int
    voltage: Periodic
    force: Periodic
    weight: float
    gains: Floats
    film_state: Floats
    bridge_state: Floats


class Rig:
    """The scene's state. All times are integer nanoseconds of the clock; call under the clock's lock."""

    def __init__(self, scene: Scene, clock: VirtualClock) -> None:
        self.scene = scene
        self._clock = clock
        self._films = scene.design.films
        amplifier = cast("ChargeAmplifier | None", scene.effects.get("charge_amplifier"))
        self._film_system: StateSpace | None = amplifier.system() if amplifier else None
        self._scatter = cast("GainScatter | None", scene.effects.get("gain_scatter"))
        self._scatter_stream = Stream(scene.seed, "gain_scatter")
        self._bridge = first_order_low_pass(0.1)
        self._sample: Sample | None = None
        self._stack: Response | None = None
        self.position = 0.0
        self._weight = 0.0
        self._set_at_ns = 0
        order = self._film_system.order if self._film_system else 0
        silence = Periodic(0.0, 10_000, 0, 0, np.array([1]), np.zeros(1, complex))
        gains = self._gains()
        self._segments = deque(
            [Segment(0, silence, silence, 0.0, gains, np.zeros((len(self._films), order)), np.zeros(1))]
        )

    # --- what can change -------------------------------------------------------------------------------

    def set_voltage(self, voltage: Periodic) -> None:
        """The voltage at the shaker's coil from now on."""
        if not np.array_equal(voltage.amplitude, self._segments[-1].voltage.amplitude):
            self._set_at_ns = self._clock.now_ns()
        self._begin(voltage)

    def set_position(self, position: float) -> None:
        """The positioner stands at `position` m."""
        self.position = position
        self._begin(self._segments[-1].voltage)

    def mount(self, sample: Sample) -> None:
        self._sample = sample
        self._stack = response(
            self.scene.design, Load(force=1.0, sensed=sample), self.scene.model, self.scene.tolerance
        )
        self._begin(self._segments[-1].voltage)

    def place_weight(self, mass: float) -> None:
        """Dead weights of `mass` kg in all stand on the load cell."""
        self._weight = mass * STANDARD_GRAVITY
        self._begin(self._segments[-1].voltage)

    def set_bridge_filter(self, tau: float) -> None:
        """Time constant of the indicator's filter, s."""
        state = self._bridge_state(self._clock.now_ns())
        self._bridge = first_order_low_pass(tau)
        self._begin(self._segments[-1].voltage, bridge_state=state)

    def reset_film(self, channel: int) -> None:
        """The integrator of a channel's charge amplifier is shorted: its output starts from zero."""
        now = self._clock.now_ns()
        last = self._segments[-1]
        state = self._film_state(now)
        for film, film_state, gain in zip(self._films, state, last.gains, strict=True):
            if film.channel == channel and self._film_system is not None:
                film_state[0] = gain * float(last.force.at(np.array([now]))[0])
        self._begin(last.voltage, film_state=state)

    # --- what can be seen ------------------------------------------------------------------------------

    def film_voltages(self, time_ns: npt.NDArray[np.int64]) -> Floats:
        """Charge amplifier outputs, shape (films, n), V, at times in the present segment."""
        segment = self._segments[-1]
        if self._film_system is None:
            return np.outer(segment.gains, segment.force.at(time_ns))
        return np.array(
            [
                self._film_system.output(segment.force.scaled(gain), state, time_ns)
                for gain, state in zip(segment.gains, segment.film_state, strict=True)
            ]
        )

    def cell_force(self, time_ns: npt.NDArray[np.int64]) -> Floats:
        """Force on the load cell, N, shape (n,), at times of the last 12 s."""
        force = np.empty(len(time_ns))
        starts = np.array([s.start_ns for s in self._segments])
        index = np.maximum(np.searchsorted(starts, time_ns, side="right") - 1, 0)
        for i in np.unique(index):
            segment, here = self._segments[i], index == i
            force[here] = segment.force.at(time_ns[here]) + segment.weight
        return force

    def filtered_cell_force(self, time_ns: int) -> float:
        """Force on the load cell behind the indicator's filter, N, at a time in the present segment."""
        return float(self._bridge_state(time_ns)[0])

    def coil_voltage(self) -> Periodic:
        return self._segments[-1].voltage

    def settled_for_ns(self) -> int:
        """How long nothing has changed."""
        return self._clock.now_ns() - self._segments[-1].start_ns

    # --- how it follows --------------------------------------------------------------------------------

    def _begin(self, voltage: Periodic, film_state: Floats | None = None, bridge_state: Floats | None = None) -> None:
        now = self._clock.now_ns()
        voltage = voltage.restarted(now)
        force = self._contact_force(voltage)
        segment = Segment(
            now,
            voltage,
            force,
            self._weight,
            self._gains(),
            self._film_state(now) if film_state is None else film_state,
            self._bridge_state(now) if bridge_state is None else bridge_state,
        )
        if self._segments[-1].start_ns == now:
            self._segments.pop()
        self._segments.append(segment)
        while len(self._segments) > 1 and self._segments[1].start_ns < now - HISTORY_NS:
            self._segments.popleft()

    def _gains(self) -> Floats:
        fraction = {"total": 1.0, "rigid": self._stack.force_ratio if self._stack else 0.0}
        gains = np.array([film.sensitivity * fraction[film.name] for film in self._films])
        if self._scatter is not None:
            gains = gains * self._scatter.gains(self.scene.design, self._scatter_stream, self._set_at_ns)
        return gains

    def _contact_force(self, voltage: Periodic) -> Periodic:
        """Force of the probe on the sample; it can only press, so it is clipped at zero where contact is lost."""
        rig = self.scene.rig
        if self._sample is None or self._stack is None:
            return voltage.scaled(0.0)
        share = self._stack.stiffness / (rig.suspension_stiffness + self._stack.stiffness)
        advance = self.position - (rig.sensor_position - self._sample.thickness)
        linear = voltage.scaled(
            share * rig.force_constant / rig.coil_resistance, offset=share * rig.suspension_stiffness * advance
        )
        least, greatest = linear.extremes()
        if least >= 0:
            return linear
        if greatest <= 0:
            return voltage.scaled(0.0)
        turns = np.arange(CONTACT_POINTS) / CONTACT_POINTS
        wave = linear.mean + (linear.amplitude @ np.exp(2j * np.pi * np.outer(linear.order, turns))).real
        spectrum = np.fft.rfft(np.maximum(wave, 0.0)) / CONTACT_POINTS
        return Periodic(
            float(spectrum[0].real),
            linear.frequency,
            linear.start_ns,
            linear.start_phase,
            np.arange(1, CONTACT_HARMONICS + 1),
            2 * spectrum[1 : CONTACT_HARMONICS + 1],
        )

    def _film_state(self, time_ns: int) -> Floats:
        segment = self._segments[-1]
        if self._film_system is None:
            return segment.film_state
        at = np.array([time_ns])
        return np.array(
            [
                self._film_system.state(segment.force.scaled(gain), state, at)[:, 0]
                for gain, state in zip(segment.gains, segment.film_state, strict=True)
            ]
        )

    def _bridge_state(self, time_ns: int) -> Floats:
        segment = self._segments[-1]
        on_cell = segment.force.scaled(1.0, offset=segment.weight)
        return self._bridge.state(on_cell, segment.bridge_state, np.array([time_ns]))[:, 0]
