"""The physical rig behind the simulated devices: the force, and the signals of the films and of the load cell.

Between two changes (a setting written, a sample mounted, a move ended) the drive is periodic and the chain is piecewise
linear. The state at any time therefore has a closed form: there is no time step, and no result depends on when a client
asks for it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from palpate.instrument.calibration.load_cell_fit import STANDARD_GRAVITY
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.effects import in_order
from palpate.simulators.linear.lti import Floats, StateSpace
from palpate.simulators.linear.path import KEPT_NS, Path, split
from palpate.simulators.linear.periodic import CYCLE, HERTZ, Periodic, constant
from palpate.simulators.physics.chain import MeasuringChain
from palpate.simulators.physics.in_order import Effects
from palpate.simulators.physics.parts import Touch
from palpate.simulators.randomness import Stream
from palpate.simulators.rig.assembly import chain_of, film_signals, response_of
from palpate.simulators.rig.mounted import Mounted
from palpate.simulators.scenes.scene import Scene

BRIDGE_TAU = 0.1  # s, time constant of the indicator's filter at power-on


class Rig:
    """The state of a scene. All times are integer nanoseconds of the clock; call its methods under the clock's lock."""

    def __init__(self, scene: Scene, clock: VirtualClock) -> None:
        self.effects = Effects(in_order(scene.effects))
        self.scene = scene = replace(scene, effects=self.effects)
        self._clock = clock
        self._films = scene.design.films
        self._streams = {
            each.name: Stream(scene.seed, each.name) for each in (*self.effects.share, *self.effects.films)
        }
        self._leak = self.effects.leak if self.effects.amplifier else None  # without an amplifier no charge leaks away
        self._bridge_tau = BRIDGE_TAU
        self._mounted = Mounted(scene.design)
        self.position = 0.0
        self.cell_position = 0.0  # degrees
        self.placed: list[tuple[int, float]] = []  # each change of the dead weights: clock time [ns] and force [N]
        self._weight = 0.0
        self._ambient = 0.0
        self._set_at_ns = 0
        self._mounted_at_ns = 0
        self._changed_ns = 0
        self.changes = 0  # counts changes of any kind
        self.exchanges = 0  # counts changes of what lies under the probe
        silence = Periodic(0.0, 10 * HERTZ, 0, 0, np.array([1]), np.zeros(1, complex))
        self._gains: tuple[object, ...] = ()  # settings for which `_signals` was built
        self._settings: tuple[object, ...] = ()  # settings for which the last chain was built
        self._last = chain = self._chain()
        mode = chain.mode(Touch(contact=(False, False), drag=(0,) * chain.plays))
        self._paths = deque([Path(_inputs(silence, 0), mode, 0, np.zeros(mode.system.order), clock.check)])
        self._voltage = silence

    # --- what can change -------------------------------------------------------------------------------

    def set_voltage(self, voltage: Periodic) -> None:
        """Apply a voltage to the shaker's coil from now on [V]."""
        for effect in self.effects.drive:
            voltage = replace(voltage, frequency=effect.frequency(voltage.frequency))
        before, self._voltage = self._voltage, voltage
        alike = np.array_equal(voltage.amplitude, before.amplitude)
        if alike and voltage.mean == before.mean and not voltage.amplitude.any():
            return  # a constant has no phase: nothing changes
        if not alike:
            self._set_at_ns = self._clock.now_ns()
        self._begin()

    def set_position(self, position: float) -> None:
        """Put the positioner at `position` [m]."""
        self.position = position
        self._begin()

    def mount(self, sample: Sample) -> None:
        """Lay a sample on the sensor. Raises RangeError as `response_of` does."""
        response = response_of(self.scene, self.effects, sample, self._streams, self._clock.now_ns())
        self._lay(Mounted(self.scene.design, sample, response=response))

    def take_off(self) -> None:
        """Take away what lies under the probe."""
        self._lay(Mounted(self.scene.design))

    def place_probe(self, x: float, y: float) -> None:
        """Make the probe a point above (x, y), from the sensor's corner [m]. The stack keeps its stiffness [A].

        Raises RangeError: no sample lies on the sensor, or no model gives the teeth's shares of the force there.
        """
        self._mounted = self._mounted.probed(x, y)
        self._begin()

    def lay_on_support(self, sample: Sample | None) -> None:
        """Put a rigid support of the same height in the sensor's place, and the sample on it (None: no sample)."""
        self._lay(Mounted(self.scene.design, sample, on_support=True))

    def press_tooth(self, tooth: int) -> None:
        """Put a pin on one tooth, by its index from 0; this tooth then takes the whole force."""
        self._lay(Mounted(self.scene.design, tooth=tooth))

    def place_weight(self, mass: float) -> None:
        """Load the load cell with dead weights of `mass` in total [kg]."""
        self.placed.append((self._clock.now_ns(), mass * STANDARD_GRAVITY - self._weight))
        self._weight = mass * STANDARD_GRAVITY
        self._begin()

    def set_temperature(self, kelvin: float) -> None:
        """Set how much warmer the surroundings are than when the bench was opened [K]."""
        self._ambient = kelvin
        self._begin()

    def turn_load_cell(self, degrees: float) -> None:
        """Turn the load cell about its axis to `degrees`."""
        self.cell_position = degrees
        self._begin()

    def set_bridge_filter(self, tau: float) -> None:
        """Set the time constant of the indicator's filter [s]."""
        self._bridge_tau = tau
        self._begin()

    def reset_film(self, channel: int) -> None:
        """Discharge the integrator of a channel's charge amplifier, so that its output starts from zero."""
        now = self._clock.now_ns()
        state = self._paths[-1].state(now)
        system = self._paths[-1].mode_at(now).system
        for number, film in enumerate(self._films):
            own = self._last.amplifier_states.get(number)
            if film.channel == channel and own is not None:
                output = float(self._paths[-1].outputs(np.array([now]), slice(number, number + 1))[0, 0])
                state[own] -= output / system.c[number, own]
        self._begin(state)

    # --- what can be seen ------------------------------------------------------------------------------

    @property
    def sample(self) -> Sample | None:
        """The sample under the probe; None: there is none."""
        return self._mounted.sample

    def film_rates(self, time_ns: npt.NDArray[np.int64], step_ns: int = 0) -> Floats:
        """Rates of change of the amplifier outputs, shape (films, n) [V/s]; arguments as for `film_voltages`."""
        return self._paths[-1].rates(time_ns, slice(0, len(self._films)), step_ns)

    def film_voltages(self, time_ns: npt.NDArray[np.int64], step_ns: int = 0) -> Floats:
        """Amplifier outputs, shape (films, n) [V].

        Args:
            time_ns: ascending clock times, shape (n,), not before the last change of a setting [ns].
            step_ns: the constant step between the times, which allows a faster method that may round differently; 0:
                the times have no constant step [ns].
        """
        return self._paths[-1].outputs(time_ns, slice(0, len(self._films)), step_ns)

    def cell_force(self, time_ns: npt.NDArray[np.int64], step_ns: int = 0) -> Floats:
        """Force on the load cell, shape (n,) [N], at ascending times of the last 12 s; `step_ns` as for the films."""
        rows = slice(self._last.force, self._last.force + 1)
        pieces = split(time_ns, [path.start_ns for path in self._paths][1:])
        parts = zip(self._paths, pieces, strict=True)
        force: Floats = np.concatenate([path.outputs(piece, rows, step_ns)[0] for path, piece in parts if len(piece)])
        return force

    def filtered_cell_force(self, time_ns: int) -> float:
        """Force on the load cell after the indicator's filter [N], at a time since the last change of a setting."""
        rows = slice(self._last.bridge, self._last.bridge + 1)
        return float(self._paths[-1].outputs(np.array([time_ns]), rows)[0, 0])

    def transfer(self, frequency: float) -> npt.NDArray[np.complex128]:
        """Complex gains at a frequency [Hz] from the coil's voltage to film voltages [V/V] and to the force [N/V].

        Returns: shape (films + 1,); the last is that of the force on the load cell.
        """
        system = self._paths[-1].mode_at(self._clock.now_ns()).system
        rows = [*range(len(self._films)), self._last.force]
        gains: npt.NDArray[np.complex128] = system.transfer(frequency)[:, 0].take(rows)
        return gains

    def without_limits(self) -> tuple[StateSpace, list[int]]:
        """The chain as a linear system, and the indices of the play operators' states in it.

        The system's outputs are the film voltages and the force on the load cell (films + 1). No limit acts in it, and
        each play operator follows its force.
        """
        system = self._last.mode(Touch(drag=(1,) * self._last.plays)).system
        rows = [*range(len(self._films)), self._last.force]
        return StateSpace(system.a, system.b, system.c[rows], system.d[rows]), list(self._last.play_states)

    @property
    def path(self) -> Path:
        """The motion with the present settings."""
        return self._paths[-1]

    def path_from(self, phase: int) -> Path:
        """The motion with a drive that begins later in its period by a phase [1/CYCLE]; all else is equal."""
        path = self._paths[-1]
        voltage = replace(self._voltage, start_phase=(self._voltage.start_phase + phase) % CYCLE)
        start_ns = path.start_ns
        return Path(
            _inputs(voltage, start_ns), path.mode_at(start_ns), start_ns, path.state(start_ns), self._clock.check
        )

    def transitions(self, time_ns: int) -> list[tuple[Touch, Touch]]:
        """What touches before and after each transition between the last change of a setting and a time [ns]."""
        modes = self._paths[-1].modes_until(time_ns)
        return [(before.touch, after.touch) for before, after in pairwise(modes)]

    def coil_voltage(self) -> Periodic:
        return self._voltage

    def settled_for_ns(self) -> int:
        """Time since the last change of a setting [ns]."""
        return self._clock.now_ns() - self._changed_ns

    # --- how it follows --------------------------------------------------------------------------------

    def _lay(self, mounted: Mounted) -> None:
        self._mounted, self._mounted_at_ns = mounted, self._clock.now_ns()
        self.exchanges += 1
        state = self._paths[-1].state(self._clock.now_ns())
        state[: self._last.stack_order] = 0.0  # a new sample has not crept yet
        self._begin(state)

    def _begin(self, state: Floats | None = None) -> None:
        self._changed_ns = self._clock.now_ns()
        self._restart(state)

    def _restart(self, state: Floats | None = None) -> None:
        now = self._clock.now_ns()
        self.changes += 1
        last = self._paths[-1]
        if state is None:
            state = last.state(now)
        touch = last.mode_at(now).touch
        self._voltage = self._voltage.restarted(now)
        self._last = self._chain()
        path = Path(_inputs(self._voltage, now), self._last.mode(touch), now, state, self._clock.check)
        if last.start_ns == now:
            self._paths.pop()
        self._paths.append(path)
        while len(self._paths) > 1 and self._paths[1].start_ns < now - KEPT_NS:
            self._paths.popleft()

    def _chain(self) -> MeasuringChain:
        """The chain for the present settings.

        With unchanged settings it is the last chain, which has its modes solved already.
        """
        gains = (self._mounted, self._set_at_ns, self._mounted_at_ns, self._ambient)
        if gains != self._gains:
            self._gains, self._signals = gains, self._film_signals()
        signals = self._signals
        settings = (self._mounted, self._leakage(), self.position, self._bridge_tau, self._weight)
        matrices = tuple(matrix.tobytes() for matrix in (signals.a, signals.b, signals.c, signals.d))
        if (settings, matrices) == self._settings:
            return self._last
        self._settings = settings, matrices
        mounted, *others = settings
        return chain_of(self.scene, self.effects, mounted, signals, *others)

    def _film_signals(self) -> StateSpace:
        since = (self._set_at_ns, self._mounted_at_ns)
        return film_signals(self.scene.design, self.effects, self._mounted, self._streams, *since, self._ambient)

    def _leakage(self, epoch: int | None = None) -> float:
        """Conductance across a film in the middle of an epoch of the humidity (None: the present one) [S]."""
        leak = self._leak
        if leak is None:
            return 0.0
        epoch = self._clock.now_ns() // leak.epoch_ns if epoch is None else epoch
        return leak.conductance((epoch + 0.5) * leak.epoch_ns * 1e-9)

    # --- what changes by itself ------------------------------------------------------------------------

    def next_event_ns(self) -> int:
        leak = self._leak
        if leak is None:
            return NEVER
        following = self._clock.now_ns() // leak.epoch_ns + 1
        return NEVER if self._leakage(following) == self._leakage() else following * leak.epoch_ns

    def advance(self, start_ns: int, end_ns: int) -> None:
        leak = self._leak
        if leak is not None and self._leakage(start_ns // leak.epoch_ns) != self._leakage(end_ns // leak.epoch_ns):
            self._restart()


def _inputs(voltage: Periodic, start_ns: int) -> tuple[Periodic, ...]:
    """The chain's inputs: the coil's voltage, the constant 1, and the rate of change of the voltage."""
    voltage = voltage.restarted(start_ns)
    return voltage, constant(1.0, voltage), voltage.derivative()
