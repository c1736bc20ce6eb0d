"""The physical rig behind the simulated devices: the force, and the signals of the films and of the load cell."""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.calibration.load_cell import STANDARD_GRAVITY
from palpate.instrument.contracts.own import CHANNELS, FULL_SCALE_COUNTS, place
from palpate.instrument.errors import BenchError, RangeError
from palpate.instrument.models.influence import tooth_shares
from palpate.instrument.models.table import Response
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.clock import NEVER, VirtualClock
from palpate.simulators.effects import in_order
from palpate.simulators.linear.lti import StateSpace, gain
from palpate.simulators.linear.path import KEPT_NS, Path, split
from palpate.simulators.linear.periodic import CYCLE, HERTZ, Periodic, constant
from palpate.simulators.physics.chain import Armature, Limits, MeasuringChain, Plays, SpringStack, Touch
from palpate.simulators.physics.converter import convert
from palpate.simulators.physics.effect import Effects, InputEffect
from palpate.simulators.randomness import Stream
from palpate.simulators.scenes.scene import Scene

# -------------------------------------------------------------------------------------------------------
# What lies between the probe and the load cell: its stiffness, and the part of the force that each film takes

SUPPORT_STIFFNESS = 1e6  # N/m, rigid support with the load cell below it [A]
PIN_STIFFNESS = 1e3  # N/m, rubber tip of the pin that presses one tooth [A]


@dataclass(frozen=True)
class Mounted:
    """What lies under the probe: a sample on the sensor or on a rigid support, a pin on one tooth, or nothing.

    Attributes:
        design: the sensor design.
        sample: the sample; None: there is none.
        response: force ratio and stiffness of the sensor under the sample; None without a sample on the sensor.
        on_support: True: a rigid support takes the sensor's place.
        tooth: index of the tooth on which the pin stands; None: no pin.
        probe_at: x and y of a point probe from the sensor's corner [m]; None: the probe covers the whole sample.
    """

    design: Design
    sample: Sample | None = None
    response: Response | None = None
    on_support: bool = False
    tooth: int | None = None
    probe_at: tuple[float, float] | None = None

    @property
    def thickness(self) -> float:
        """Thickness of the sample; 0 without one [m]."""
        return self.sample.thickness if self.sample else 0.0

    def probed(self, x: float, y: float) -> Mounted:
        """The same sample with a point probe above (x, y) [m].

        Raises RangeError: no sample lies on the sensor, or no model gives the teeth's shares of the force there.
        """
        if self.sample is None or self.on_support:
            raise RangeError("no sample lies on the sensor: mount one before the point probe is placed")
        tooth_shares(self.design, self.sample, (x, y))
        return replace(self, probe_at=(x, y))

    def springs(self) -> SpringStack:
        """The stack of sample and sensor as two parallel springs, one to the teeth and one to the ring.

        The scene's sensor model gives the total stiffness and the teeth's share of the force; the column model gives
        the sample's part of the compression. On the rigid support the sample is in the ring's branch, because no film
        lies below either of them.
        """
        if self.on_support:
            pad = self.sample
            compliance = 0.0 if pad is None else pad.thickness / (pad.modulus * pad.area)
            whole = compliance + 1 / SUPPORT_STIFFNESS
            return SpringStack(0.0, 1 / whole, object_share=compliance / whole)
        if self.tooth is not None:
            return SpringStack(PIN_STIFFNESS, 0.0, object_share=1.0)
        if self.response is None or self.sample is None:
            return SpringStack(0.0, 0.0, 0.0)
        ring = self.design.ring
        hardness = self.sample.modulus * ring.height / (ring.material.modulus * self.sample.thickness)
        ratio, stiffness = self.response.force_ratio, self.response.stiffness
        return SpringStack(ratio * stiffness, (1 - ratio) * stiffness, object_share=1 / (1 + hardness))

    def part(self, film: Film) -> float:
        """Fraction of the force on all teeth that the teeth of a film take; under a point probe, of the whole force."""
        if self.on_support:
            return 0.0
        if self.tooth is not None:
            return float(self.tooth in film.teeth)
        if self.probe_at is not None and self.sample is not None and film.kind != "total":
            return tooth_shares(self.design, self.sample, self.probe_at)[film.teeth[0]]
        return len(film.teeth) / len(self.design.teeth)


# --- the chain of a scene ------------------------------------------------------------------------------


def chain_of(
    scene: Scene,
    effects: Effects,
    mounted: Mounted,
    signals: StateSpace,
    leakage: float,
    position: float,
    bridge_tau: float,
    weight: float,
) -> MeasuringChain:
    """The chain of a scene with its present settings.

    Args:
        scene: the scene.
        effects: the scene's effects.
        mounted: what lies under the probe.
        signals: the films' voltages before their amplifiers, as `film_signals` returns them.
        leakage: conductance across a film [S].
        position: position of the positioner [m].
        bridge_tau: time constant of the indicator's filter [s].
        weight: dead weight on the load cell [N].
    """
    rig = scene.rig
    armature, limits = Armature(rig.force_constant, rig.coil_resistance, rig.suspension_stiffness), Limits()
    for effect in effects.shaker:
        armature, limits = effect.shaker(armature, limits)
    stack = mounted.springs()
    yielding = effects.stack.stack(stack) if effects.stack else stack.elastic()
    plays = effects.plays.plays() if effects.plays else Plays(ring=False, radii=(), weights=())
    films, amplifier = scene.design.films, effects.amplifier
    amplifiers, offsets = [gain(np.eye(1)) for _ in films], np.zeros(len(films))
    if amplifier is not None:
        amplifiers = [amplifier.system(film, scene.design, leakage) for film in films]
        offsets = np.array([amplifier.offset(film, scene.design, leakage) for film in films])
    return MeasuringChain(
        armature,
        limits,
        yielding,
        advance=position - (rig.sensor_position - mounted.thickness),
        plays=plays,
        before=signals,
        amplifiers=amplifiers,
        offsets=offsets,
        bridge_tau=bridge_tau,
        weight=weight,
    )


def film_signals(
    design: Design,
    effects: Effects,
    mounted: Mounted,
    streams: Mapping[str, Stream],
    set_at_ns: int,
    mounted_at_ns: int,
    ambient: float,
) -> StateSpace:
    """The system that turns forces into the films' voltages before their amplifiers.

    Its four inputs are the force on the teeth, on the ring and on the play operators [N], and the constant 1; its
    outputs, one for each film, are voltages [V].

    Args:
        design: the sensor design, which lists the films.
        effects: the scene's effects.
        mounted: what lies under the probe.
        streams: a random stream for each effect on the films, by the effect's name.
        set_at_ns: clock time at which the drive was last set [ns].
        mounted_at_ns: clock time at which what lies under the probe was last changed [ns].
        ambient: warming of the surroundings since the bench was opened [K].
    """
    shares = np.zeros((len(design.films), 4))
    for number, film in enumerate(design.films):
        part = mounted.part(film)
        played = part if effects.plays is not None and film.kind == effects.plays.path else 0.0
        both = film.kind == "total" or mounted.probe_at is not None
        shares[number] = (part, part if both else 0.0, played, 0.0)
    matrix = np.diag([film.sensitivity for film in design.films])
    for effect in effects.films:
        drawn_at_ns = mounted_at_ns if effect.by_mounting else set_at_ns
        matrix = effect.matrix(design, streams[effect.name], drawn_at_ns) @ matrix
    signals = gain(matrix @ shares)
    for source in effects.source:
        signals = signals.plus(source.source(design, ambient))
    return signals


def response_of(
    scene: Scene, effects: Effects, sample: Sample, streams: Mapping[str, Stream], mounted_at_ns: int
) -> Response:
    """Response of the sensor to a sample: by the scene's model, and changed by effects.

    Args:
        scene: the scene.
        effects: the scene's effects.
        sample: the sample.
        streams: a random stream for each effect that changes the share of the teeth, by the effect's name.
        mounted_at_ns: clock time at which the sample is mounted [ns].

    Raises RangeError: the model does not answer for it, or by effects the teeth take more than the force.
    """
    response = scene.answer(sample)
    changes = [effect.ln_change(sample, streams[effect.name], mounted_at_ns) for effect in effects.share]
    ratio = response.force_ratio * math.exp(math.fsum(changes))
    if changes and not ratio < 1:
        names = ", ".join(effect.name for effect in effects.share)
        raise RangeError(
            f"sample {sample.name!r} has a force ratio of {ratio:.3g} by {names}, which is not below 1: the teeth "
            f"cannot take more than the whole force; give these effects smaller parameters"
        )
    return replace(response, force_ratio=ratio, force_rigid=ratio * response.force_total)


# --- the rig -------------------------------------------------------------------------------------------

# Between two changes (a setting written, a sample mounted, a move ended) the drive is periodic and the chain is
# piecewise linear. The state at any time therefore has a closed form: there is no time step, and no result depends on
# when a client asks for it.


BRIDGE_TAU = 0.1  # s, time constant of the indicator's filter at power-on


class Rig:
    """The state of a scene. All times are integer nanoseconds of the clock; call its methods under the clock's lock."""

    def __init__(self, scene: Scene, clock: VirtualClock) -> None:
        self.effects = Effects(in_order(scene.effects))
        self.scene = scene = replace(scene, effects=self.effects)
        self.clock = clock
        self._films = scene.design.films
        self._streams = {
            each.name: Stream(scene.seed, each.name) for each in (*self.effects.share, *self.effects.films)
        }
        self._leak = self.effects.leak if self.effects.amplifier else None  # without an amplifier no charge leaks away
        self._bridge_tau = BRIDGE_TAU
        self.gage_factor = GAGE_FACTOR  # to which the load indicator is set
        self.mounted = Mounted(scene.design)
        self.position = 0.0
        self.cell_position = 0.0  # degrees
        self.placed: list[tuple[int, float]] = []  # each change of the dead weights: clock time [ns] and force [N]
        self.weight = 0.0
        self._ambient = 0.0
        self.set_at_ns = 0
        self.mounted_at_ns = 0
        self._changed_ns = 0
        self.changes = 0  # counts changes of any kind
        self.exchanges = 0  # counts changes of what lies under the probe
        silence = Periodic(0.0, 10 * HERTZ, 0, 0, np.array([1]), np.zeros(1, complex))
        self._gains: tuple[object, ...] = ()  # settings for which `_signals` was built
        self._settings: tuple[object, ...] = ()  # settings for which the last chain was built
        self.chain = chain = self._chain()
        mode = chain.mode(Touch(contact=(False, False), drag=(0,) * chain.plays))
        self.paths = deque([Path(_inputs(silence, 0), mode, 0, np.zeros(mode.system.order), clock.check)])
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
            self.set_at_ns = self.clock.now_ns()
        self._begin()

    def set_position(self, position: float) -> None:
        """Put the positioner at `position` [m]."""
        self.position = position
        self._begin()

    def mount(self, sample: Sample) -> None:
        """Lay a sample on the sensor. Raises RangeError as `response_of` does."""
        response = response_of(self.scene, self.effects, sample, self._streams, self.clock.now_ns())
        self.lay(Mounted(self.scene.design, sample, response=response))

    def take_off(self) -> None:
        """Take away what lies under the probe."""
        self.lay(Mounted(self.scene.design))

    def place_probe(self, x: float, y: float) -> None:
        """Make the probe a point above (x, y), from the sensor's corner [m]. The stack keeps its stiffness [A].

        Raises RangeError: no sample lies on the sensor, or no model gives the teeth's shares of the force there.
        """
        self.mounted = self.mounted.probed(x, y)
        self._begin()

    def lay_on_support(self, sample: Sample | None) -> None:
        """Put a rigid support of the same height in the sensor's place, and the sample on it (None: no sample)."""
        self.lay(Mounted(self.scene.design, sample, on_support=True))

    def press_tooth(self, tooth: int) -> None:
        """Put a pin on one tooth, by its index from 0; this tooth then takes the whole force."""
        self.lay(Mounted(self.scene.design, tooth=tooth))

    def place_weight(self, mass: float) -> None:
        """Load the load cell with dead weights of `mass` in total [kg]."""
        self.placed.append((self.clock.now_ns(), mass * STANDARD_GRAVITY - self.weight))
        self.weight = mass * STANDARD_GRAVITY
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
        now = self.clock.now_ns()
        state = self.paths[-1].state(now)
        system = self.paths[-1].mode_at(now).system
        for number, film in enumerate(self._films):
            own = self.chain.amplifier_states.get(number)
            if film.channel == channel and own is not None:
                output = float(self.paths[-1].outputs(np.array([now]), slice(number, number + 1))[0, 0])
                state[own] -= output / system.c[number, own]
        self._begin(state)

    # --- what can be seen ------------------------------------------------------------------------------

    @property
    def sample(self) -> Sample | None:
        """The sample under the probe; None: there is none."""
        return self.mounted.sample

    def film_rates(self, time_ns: npt.NDArray[np.int64], step_ns: int = 0) -> Floats:
        """Rates of change of the amplifier outputs, shape (films, n) [V/s]; arguments as for `film_voltages`."""
        return self.paths[-1].rates(time_ns, slice(0, len(self._films)), step_ns)

    def film_voltages(self, time_ns: npt.NDArray[np.int64], step_ns: int = 0) -> Floats:
        """Amplifier outputs, shape (films, n) [V].

        Args:
            time_ns: ascending clock times, shape (n,), not before the last change of a setting [ns].
            step_ns: the constant step between the times, which allows a faster method that may round differently; 0:
                the times have no constant step [ns].
        """
        return self.paths[-1].outputs(time_ns, slice(0, len(self._films)), step_ns)

    def cell_force(self, time_ns: npt.NDArray[np.int64], step_ns: int = 0) -> Floats:
        """Force on the load cell, shape (n,) [N], at ascending times of the last 12 s; `step_ns` as for the films."""
        rows = slice(self.chain.force, self.chain.force + 1)
        pieces = split(time_ns, [path.start_ns for path in self.paths][1:])
        parts = zip(self.paths, pieces, strict=True)
        force: Floats = np.concatenate([path.outputs(piece, rows, step_ns)[0] for path, piece in parts if len(piece)])
        return force

    def filtered_cell_force(self, time_ns: int) -> float:
        """Force on the load cell after the indicator's filter [N], at a time since the last change of a setting."""
        rows = slice(self.chain.bridge, self.chain.bridge + 1)
        return float(self.paths[-1].outputs(np.array([time_ns]), rows)[0, 0])

    def transfer(self, frequency: float) -> npt.NDArray[np.complex128]:
        """Complex gains at a frequency [Hz] from the coil's voltage to film voltages [V/V] and to the force [N/V].

        Returns: shape (films + 1,); the last is that of the force on the load cell.
        """
        system = self.paths[-1].mode_at(self.clock.now_ns()).system
        rows = [*range(len(self._films)), self.chain.force]
        gains: npt.NDArray[np.complex128] = system.transfer(frequency)[:, 0].take(rows)
        return gains

    def without_limits(self) -> tuple[StateSpace, list[int]]:
        """The chain as a linear system, and the indices of the play operators' states in it.

        The system's outputs are the film voltages and the force on the load cell (films + 1). No limit acts in it, and
        each play operator follows its force.
        """
        system = self.chain.mode(Touch(drag=(1,) * self.chain.plays)).system
        rows = [*range(len(self._films)), self.chain.force]
        return StateSpace(system.a, system.b, system.c[rows], system.d[rows]), list(self.chain.play_states)

    @property
    def path(self) -> Path:
        """The motion with the present settings."""
        return self.paths[-1]

    def path_from(self, phase: int) -> Path:
        """The motion with a drive that begins later in its period by a phase [1/CYCLE]; all else is equal."""
        path = self.paths[-1]
        voltage = replace(self._voltage, start_phase=(self._voltage.start_phase + phase) % CYCLE)
        start_ns = path.start_ns
        return Path(
            _inputs(voltage, start_ns), path.mode_at(start_ns), start_ns, path.state(start_ns), self.clock.check
        )

    def transitions(self, time_ns: int) -> list[tuple[Touch, Touch]]:
        """What touches before and after each transition between the last change of a setting and a time [ns]."""
        modes = self.paths[-1].modes_until(time_ns)
        return [(before.touch, after.touch) for before, after in pairwise(modes)]

    def coil_voltage(self) -> Periodic:
        return self._voltage

    def settled_for_ns(self) -> int:
        """Time since the last change of a setting [ns]."""
        return self.clock.now_ns() - self._changed_ns

    # --- how it follows --------------------------------------------------------------------------------

    def lay(self, mounted: Mounted) -> None:
        self.mounted, self.mounted_at_ns = mounted, self.clock.now_ns()
        self.exchanges += 1
        state = self.paths[-1].state(self.clock.now_ns())
        state[: self.chain.stack_order] = 0.0  # a new sample has not crept yet
        self._begin(state)

    def _begin(self, state: Floats | None = None) -> None:
        self._changed_ns = self.clock.now_ns()
        self._restart(state)

    def _restart(self, state: Floats | None = None) -> None:
        now = self.clock.now_ns()
        self.changes += 1
        last = self.paths[-1]
        if state is None:
            state = last.state(now)
        touch = last.mode_at(now).touch
        self._voltage = self._voltage.restarted(now)
        self.chain = self._chain()
        path = Path(_inputs(self._voltage, now), self.chain.mode(touch), now, state, self.clock.check)
        if last.start_ns == now:
            self.paths.pop()
        self.paths.append(path)
        while len(self.paths) > 1 and self.paths[1].start_ns < now - KEPT_NS:
            self.paths.popleft()

    def _chain(self) -> MeasuringChain:
        """The chain for the present settings.

        With unchanged settings it is the last chain, which has its modes solved already.
        """
        gains = (self.mounted, self.set_at_ns, self.mounted_at_ns, self._ambient)
        if gains != self._gains:
            self._gains, self._signals = gains, self.film_system()
        signals = self._signals
        settings = (self.mounted, self._leakage(), self.position, self._bridge_tau, self.weight)
        matrices = tuple(matrix.tobytes() for matrix in (signals.a, signals.b, signals.c, signals.d))
        if (settings, matrices) == self._settings:
            return self.chain
        self._settings = settings, matrices
        mounted, *others = settings
        return chain_of(self.scene, self.effects, mounted, signals, *others)

    def film_system(self) -> StateSpace:
        since = (self.set_at_ns, self.mounted_at_ns)
        return film_signals(self.scene.design, self.effects, self.mounted, self._streams, *since, self._ambient)

    def _leakage(self, epoch: int | None = None) -> float:
        """Conductance across a film in the middle of an epoch of the humidity (None: the present one) [S]."""
        leak = self._leak
        if leak is None:
            return 0.0
        epoch = self.clock.now_ns() // leak.epoch_ns if epoch is None else epoch
        return leak.conductance((epoch + 0.5) * leak.epoch_ns * 1e-9)

    # --- what changes by itself ------------------------------------------------------------------------

    def next_event_ns(self) -> int:
        leak = self._leak
        if leak is None:
            return NEVER
        following = self.clock.now_ns() // leak.epoch_ns + 1
        return NEVER if self._leakage(following) == self._leakage() else following * leak.epoch_ns

    def advance(self, start_ns: int, end_ns: int) -> None:
        leak = self._leak
        if leak is not None and self._leakage(start_ns // leak.epoch_ns) != self._leakage(end_ns // leak.epoch_ns):
            self._restart()


def _inputs(voltage: Periodic, start_ns: int) -> tuple[Periodic, ...]:
    """The chain's inputs: the coil's voltage, the constant 1, and the rate of change of the voltage."""
    voltage = voltage.restarted(start_ns)
    return voltage, constant(1.0, voltage), voltage.derivative()


# --- The load cell of the rig with its bridge, as every simulated load indicator reads it --------------

IDEAL_SENSITIVITY = 10.306e-3  # V/N in a scene without the effect `load_cell`: line through Table 5.1 [T]
GAGE_FACTOR = 8.98  # gage factor for which the sensitivities are given [T]
IDEAL_DECIMALS = 4  # decimals of a display in a scene without the effect `load_cell`


class RigLoadCell:
    """The load cell under the probe. Call its methods under the clock's lock."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._cell = rig.effects.cell
        self._stream = Stream(rig.scene.seed, self._cell.name if self._cell else "")

    @property
    def decimals(self) -> int:
        """Decimals of a display in mV."""
        return self._cell.digits if self._cell else IDEAL_DECIMALS

    def signal(self, force: float, gage_factor: float = GAGE_FACTOR) -> float:
        """What the bridge gives for a force on the cell [N], at a gage factor, without offset and noise [mV]."""
        sensitivity = self._cell.in_position(self._rig.cell_position) if self._cell else IDEAL_SENSITIVITY
        return 1e3 * force * sensitivity * GAGE_FACTOR / gage_factor

    def output(self, time_ns: Times, period_ns: int) -> Floats:
        """The indicator's analogue output at times a period apart (n,) [V]: what the display shows, without its steps.

        It is as fast as the force, and each sample has the noise of a reading [A].
        """
        volts = self._output(self._rig.path.outputs, time_ns, period_ns)
        if self._cell:
            stream = Stream(self._rig.scene.seed, self._cell.name, "output", period_ns)
            volts += 1e-3 * self._cell.added_mV(stream, int(time_ns[0]) // period_ns, len(time_ns))
        return volts

    def output_rates(self, time_ns: Times, period_ns: int) -> Floats:
        """Rates of the analogue output there, without noise (n,) [V/s]."""
        return self._output(self._rig.path.rates, time_ns, period_ns)

    def _output(self, seen: Callable[[Times, slice, int], Floats], time_ns: Times, period_ns: int) -> Floats:
        row = self._rig.chain.force
        force: Floats = seen(time_ns, slice(row, row + 1), period_ns)[0]
        return force * 1e-3 * self.signal(1.0, self._rig.gage_factor)

    def shown(self, signal: float, update: int) -> float:
        """A signal [mV] with the offset, noise and steps of the display, at its update of that number."""
        return self._cell.display(signal, self._stream, update) if self._cell else signal

    def given(self, signal: float, update: int) -> float:
        """A signal [mV] with offset and noise, as a display gets it that has steps of its own."""
        return signal + float(self._cell.added_mV(self._stream, update, 1)[0]) if self._cell else signal

    def crept(self, force: float, now_ns: int) -> float:
        """Force that the cell feels [N], where `force` stands on it."""
        return self._cell.crept(force, self._rig.placed, now_ns) if self._cell else force

    def forces(self, until_ns: int, count: int, step_ns: int) -> Floats:
        """Forces on the cell at `count` times, a step apart, up to a time of the last 12 s (count,) [N]."""
        return self._rig.cell_force(until_ns - np.arange(count - 1, -1, -1) * step_ns, step_ns)


# -------------------------------------------------------------------------------------------------------
# The inputs of a node that samples: what is wired to it, films and load cell, and what is added to their voltages

Source = tuple[InputEffect, Stream, int | slice]


class FilmInputs:
    """The inputs of one node.

    A design with more films than one node has channels is wired to nodes 1, 2, ... in turn. Films that fit on one node
    are wired to every node.
    """

    def __init__(self, rig: Rig, node_id: int, number: int, channels: int = CHANNELS) -> None:
        """Wire a node.

        Args:
            rig: what the films feel.
            node_id: its node id, with which the random numbers of its inputs begin.
            number: which of the nodes that sample films it is, from 1; 0: no film is wired to it.
            channels: number of its channels.
        """
        self._rig, self._id, self._number, self.channels = rig, node_id, number, channels
        self._added = sorted(rig.effects.input, key=lambda effect: effect.name)
        self._sources: dict[int, list[Source]] = {}
        self._cell = RigLoadCell(rig)
        self._load: int | None = None  # index of the channel with the load cell's output
        if (channel := rig.scene.file.load_channel) is not None and place(channel, channels)[0] == number:
            self._load = place(channel, channels)[1] - 1

    def volts(self, time_ns: npt.NDArray[np.int64], films: Floats, period_ns: int) -> Floats:
        """What its converter gets, shape (channels, n) [V].

        Args:
            time_ns: times of the samples, one SYNC period apart, shape (n,) [ns].
            films: voltage at each channel, shape (channels, n) [V].
            period_ns: the SYNC period [ns].
        """

        @functools.cache
        def rates() -> Floats:
            found: Floats = self.film_channels @ self._rig.film_rates(time_ns, period_ns)
            if self._load is not None:
                found[self._load] = self._cell.output_rates(time_ns, period_ns)
            return found

        if self._load is not None:
            films = films.copy()
            films[self._load] = self._cell.output(time_ns, period_ns)
        return self.with_added(films, self._added_by(period_ns), time_ns, period_ns, rates)

    def converted(
        self, time_ns: Times, films: Floats, period_ns: int, ranges: Sequence[float]
    ) -> tuple[npt.NDArray[np.int16], npt.NDArray[np.uint8]]:
        """Counts (n, channels) of our own nodes' converter, and a bit for each saturated channel (n,).

        Args:
            time_ns, films, period_ns: as of `volts`.
            ranges: range of each channel [V].
        """
        volts = self.volts(time_ns, films, period_ns)
        volts /= np.array(ranges)[:, np.newaxis]
        converter = self._rig.effects.converter
        fraction, saturated = (converter.convert if converter else convert)(volts)
        fraction *= FULL_SCALE_COUNTS
        bits = np.zeros(len(time_ns), np.uint8)
        if saturated.any():
            bits = np.packbits(saturated, axis=0, bitorder="little")[0]
            fraction[np.isnan(fraction)] = 0.0  # the saturation bit marks it; an integer cannot hold NaN
        counts = np.empty((len(time_ns), self.channels), "<i2")
        for channel in range(self.channels):
            counts[:, channel] = fraction[channel]  # twice as fast as one assignment for all channels
        return counts, bits

    @staticmethod
    def with_added(
        films: Floats, sources: Sequence[Source], time_ns: Times, period_ns: int, rates: Callable[[], Floats]
    ) -> Floats:
        """Voltages with what some sources add to them. `rates` gives their rates (channels, n) [V/s]."""
        volts = films.copy()
        for effect, stream, channel in sources:
            volts[channel] += effect.volts(stream, time_ns, period_ns, functools.partial(_row, rates, channel))
        return volts

    def sources(self, period_ns: int, seed: int) -> list[Source]:
        """The effects at the input under a seed, each with its stream and channels."""
        its: list[Source] = []
        each: list[tuple[int, int | slice]] = [(channel, channel) for channel in self._wired]
        for effect in self._added:
            for number, channel in [(0, slice(None))] if effect.common else each:
                its.append((effect, Stream(seed, effect.name, self._id, number, period_ns), channel))
        return its

    def _added_by(self, period_ns: int) -> list[Source]:
        """The sources of the rig's own seed; kept, so that streams keep what they drew."""
        if period_ns not in self._sources:
            self._sources[period_ns] = self.sources(period_ns, self._rig.scene.seed)
        return self._sources[period_ns]

    @functools.cached_property
    def _wired(self) -> list[int]:
        """The channels that have a film or the load cell's output; on others nothing is drawn."""
        wired: list[int] = np.flatnonzero(self.film_channels.any(axis=1)).tolist()
        return wired if self._load is None else sorted({*wired, self._load})

    @functools.cached_property
    def film_channels(self) -> Floats:
        """Matrix of zeros and ones, shape (channels, films), that puts each film of this node on its channel."""
        films = self._rig.scene.design.films
        matrix = np.zeros((self.channels, len(films)))
        for i, film in enumerate(films):
            channel = self.wired(film)
            if channel is not None:
                matrix[channel - 1, i] = 1.0
        return matrix

    def wired(self, film: Film) -> int | None:
        """This node's channel of a film, from 1; None: the film is wired to another node."""
        node, channel = place(film.channel, self.channels)
        films = self._rig.scene.design.films
        alike = self._number > 0 and all(place(other.channel, self.channels)[0] == 1 for other in films)
        return channel if alike or node == self._number else None


def _row(rows: Callable[[], Floats], number: int | slice) -> Floats:
    row: Floats = rows()[number]
    return row


# -------------------------------------------------------------------------------------------------------
# The simulated operator: does each task without waiting for anybody, and lets the bench's clock run on
# meanwhile

MOUNTING = 60.0  # s, for a task under the probe, and to turn the load cell [A]
PLACING = 10.0  # s, to place a weight or to set the temperature [A]


class OwnTime(Protocol):
    """The clock on which the operator's work takes time."""

    lock: AbstractContextManager[Any]

    def wait(self, duration: float) -> None: ...


class SimulatedOperator:
    """A `palpate.instrument.bench.operator.Operator` who changes the simulated rig."""

    def __init__(self, rig: Rig, clock: OwnTime) -> None:
        self._rig = rig
        self._clock = clock

    def mount(self, sample: Sample) -> None:
        self._under_the_probe(lambda: self._rig.mount(sample))

    def lay_on_support(self, sample: Sample | None) -> None:
        self._under_the_probe(lambda: self._rig.lay_on_support(sample))

    def place_probe(self, x: float, y: float) -> None:
        self._under_the_probe(lambda: self._rig.place_probe(x, y))

    def press_tooth(self, tooth: int) -> None:
        self._under_the_probe(lambda: self._rig.press_tooth(tooth))

    def place_weight(self, mass: float) -> None:
        self._clock.wait(PLACING)
        with self._clock.lock:
            self._rig.place_weight(mass)

    def turn_load_cell(self, degrees: float) -> None:
        self._clock.wait(MOUNTING)
        with self._clock.lock:
            self._rig.turn_load_cell(degrees)

    def set_temperature(self, kelvin: float) -> None:
        self._clock.wait(PLACING)
        with self._clock.lock:
            self._rig.set_temperature(kelvin)

    def _under_the_probe(self, put: Callable[[], None]) -> None:
        self._clock.wait(MOUNTING)
        with self._clock.lock:
            if self._rig.position > 0:
                raise BenchError(
                    f"the probe stands at {1e3 * self._rig.position:g} mm: move it home before mounting a sample"
                )
            put()

    def confirm_device(self, what: str, label: str) -> None:
        """A simulated device is what its bench says."""
