"""Waveforms at each stage of a scene's chain over some periods of the drive, without devices."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.contracts.own import FULL_SCALE_COUNTS, place
from palpate.instrument.errors import RangeError
from palpate.instrument.sensor.design import FILM_KINDS
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.clock import VirtualClock
from palpate.simulators.linear.periodic import HERTZ, Periodic
from palpate.simulators.physics.chain import Armature, Limits
from palpate.simulators.physics.effect import Effects
from palpate.simulators.planning.plan import (
    CLOSED_FORM,
    PRELOAD,
    SETTLED,
    WIDEST,
    Question,
    driven,
    moves,
    path_of,
    sampled,
)
from palpate.simulators.planning.plan import SETTLING as LOAD_SETTLING
from palpate.simulators.rig import FilmInputs, Rig
from palpate.simulators.scenes.scene import Scene

SETTLING = 5.0  # s after the drive was set, as in a load sweep
POINTS = 400  # samples in a period
SAMPLES_PER_CYCLE = 25


@dataclass(frozen=True, slots=True, eq=False)
class Waveforms:
    """Functions of time from the first moment on; films in the order of the design.

    Attributes:
        time: (n,) s.
        coil: voltage at the coil (n,) V.
        force: force on the load cell (n,) N.
        before: films before their amplifiers (films, n) V.
        films: films behind their amplifiers (films, n) V.
        sample_time: (m,) s.
        samples: samples of the nodes (films, m) V.
        saturated: (films, m).
        load: samples of the load indicator's output (m,) V; None: no channel samples it.
    """

    time: Floats
    coil: Floats
    force: Floats
    before: Floats
    films: Floats
    sample_time: Floats
    samples: Floats
    saturated: npt.NDArray[np.bool_]
    load: Floats | None


def waveforms(scene: Scene, question: Question, periods: int) -> Waveforms:
    """The waveforms of a settled measurement.

    Raises:
        RangeError: the scene's model does not answer for the sample.
    """
    rig = driven(scene, question)
    bare = rig.effects.but(rig.effects.amplifier)
    period_ns = round(1e9 / (SAMPLES_PER_CYCLE * question.frequency))
    first = round(SETTLING * 1e9) // period_ns
    samples_ns = (first + np.arange(periods * SAMPLES_PER_CYCLE + 1)) * period_ns
    time_ns = np.linspace(samples_ns[0], samples_ns[-1], periods * POINTS + 1).astype(np.int64)
    samples, saturated = sampled(scene, rig, samples_ns, period_ns)
    return Waveforms(
        time=1e-9 * (time_ns - time_ns[0]),
        coil=_clipped(rig.effects, rig.coil_voltage().at(time_ns)),
        force=rig.cell_force(time_ns),
        before=driven(replace(scene, effects=bare), question).film_voltages(time_ns),
        films=rig.film_voltages(time_ns),
        sample_time=1e-9 * (samples_ns - time_ns[0]),
        samples=samples,
        saturated=saturated,
        load=_load_sampled(scene, rig, samples_ns, period_ns),
    )


def _load_sampled(scene: Scene, rig: Rig, time_ns: Times, period_ns: int) -> Floats | None:
    if scene.file.load_channel is None:
        return None
    node, channel = place(scene.file.load_channel)
    inputs = FilmInputs(rig, node, node)
    at_inputs = inputs.film_channels @ rig.film_voltages(time_ns)
    counts, _ = inputs.converted(time_ns, at_inputs, period_ns, inputs.channels * [WIDEST])
    return np.asarray(counts[:, channel - 1] * (WIDEST / FULL_SCALE_COUNTS), np.float64)


def _clipped(effects: Effects, volts: Floats) -> Floats:
    """Voltage clipped at the amplifier's rail."""
    armature, limits = Armature(1.0, 1.0, 1.0), Limits()
    for effect in effects.shaker:
        armature, limits = effect.shaker(armature, limits)
    return volts if limits.rail is None else np.clip(volts, -limits.rail, limits.rail)


# --- What the nodes sample of all films over a dwell, without devices ------------------------------------


def films_sampled(scene: Scene, question: Question, dwell: float, start: float = 0.0) -> tuple[Floats, Floats]:
    """Times (n,) [s] and voltages (films, n) [V] of the nodes' samples over a dwell, after the load has settled.

    Args:
        scene: the scene.
        question: sample, load and frequency.
        dwell: dwell [s].
        start: time of the bench at which the drive is set [s].
    """
    period_ns = round(1e9 / (SAMPLES_PER_CYCLE * question.frequency))
    first, count = -(-round(1e9 * (start + LOAD_SETTLING)) // period_ns), round(1e9 * dwell / period_ns)
    times = (first + np.arange(count)) * period_ns
    clock = VirtualClock()
    clock.wait(start)
    volts, _ = sampled(scene, driven(scene, question, clock), times, period_ns)
    return 1e-9 * (times - times[0]), volts


# -------------------------------------------------------------------------------------------------------
# A long record of a tooth's film and its base's film under a settled load, without devices
#
# The gains' scatter is left out, because within one load set it is a constant that no record shows.


@dataclass(frozen=True, slots=True, eq=False)
class LongRecord:
    """Samples of two films.

    Attributes:
        time: (n,) s.
        voltage: (2, n) V, the first tooth's film and its base's.
        ratio: true ratio of the two amplitudes, by the sensor and the mounted object alone.
    """

    time: Floats
    voltage: Floats
    ratio: float


def long_record(scene: Scene, question: Question, rate: float) -> LongRecord:
    """The record of a question's load over its dwell, at `rate` samples a second.

    Raises:
        RangeError: the scene's model does not answer for the sample.
    """
    films = scene.design.films
    tooth = next(film for film in films if film.kind == FILM_KINDS[0])
    base = next(film for film in films if film.kind == FILM_KINDS[1] and set(tooth.teeth) <= set(film.teeth))
    pair = [films.index(tooth), films.index(base)]
    effects = Effects(scene.effects)
    kept = replace(scene, effects=effects.but(effects.scattering))
    period_ns = round(1e9 / rate)
    first = round(SETTLING * 1e9) // period_ns
    time_ns = (first + np.arange(round(question.dwell * rate))) * period_ns
    voltage, _ = sampled(kept, driven(kept, question), time_ns, period_ns)
    touched = {effect.name: effect for effect in (*effects.share, effects.stack) if effect}
    gains = np.abs(driven(replace(scene, effects=touched), question).transfer(question.frequency))[pair]
    return LongRecord(time=1e-9 * (time_ns - time_ns[0]), voltage=voltage[pair], ratio=float(gains[0] / gains[1]))


# -------------------------------------------------------------------------------------------------------
# A sweep of loads on a scene in closed form, without devices: the nodes' samples of each settled load set
#
# The load is not set by the load cell. The drive is computed from the scene's own transfer function.


@dataclass(frozen=True, slots=True, eq=False)
class LoadSet:
    """Films of the design under one load.

    Attributes:
        load: load, peak to peak [N].
        time: (n,) s, from the first sample on.
        voltage: (films, n) V.
        saturated: (films, n).
    """

    load: float
    time: Floats
    voltage: Floats
    saturated: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class SettledLoad:
    """A rig under a settled load.

    Attributes:
        load: load, peak to peak [N].
        time_ns: times of the samples, `period_ns` apart (n,) [ns].
        set_ns: times at which the drive was set since the load before; gains may be drawn anew at each [ns].
    """

    load: float
    rig: Rig
    time_ns: Times
    period_ns: int
    set_ns: tuple[int, ...]

    @property
    def seconds(self) -> Floats:
        """The times from the first sample on (n,) [s]."""
        return np.asarray(1e-9 * (self.time_ns - self.time_ns[0]))


def load_sets(
    scene: Scene, sample: Sample, loads: Sequence[float], frequency: float, dwell: float
) -> Iterator[LoadSet]:
    """Each load in turn: the drive is set, settles, and the films are sampled 25 times a cycle over the dwell.

    Arguments and errors are those of `settled_loads`.
    """
    for at in settled_loads(scene, sample, loads, frequency, dwell):
        voltage, saturated = sampled(scene, at.rig, at.time_ns, at.period_ns)
        yield LoadSet(at.load, at.seconds, voltage, saturated)


def settled_loads(
    scene: Scene, sample: Sample, loads: Sequence[float], frequency: float, dwell: float
) -> Iterator[SettledLoad]:
    """The rig of a scene under each load in turn.

    Before a load that is repeated the drive goes off for a cycle, so that each repetition is a load set of its own.

    Args:
        scene: the scene.
        sample: the mounted sample.
        loads: loads, peak to peak [N].
        frequency: frequency of the drive [Hz].
        dwell: dwell [s].

    Raises:
        RangeError: the scene has faults or a limit acts, so that there is no closed form; or its model does not answer
            for the sample.
    """
    if scene.faults:
        raise RangeError(f"scene {scene.name!r} has faults, which only a bench meets; take how = 'bench'")
    clock = VirtualClock()
    rig = Rig(scene, clock)
    clock.add(rig)
    rig.mount(sample)
    stiffness = scene.answer(sample).stiffness
    pressed = PRELOAD * max(loads) * (1 / stiffness + 1 / scene.rig.suspension_stiffness)
    rig.set_position(scene.rig.sensor_position - sample.thickness + pressed)
    period_ns = round(1e9 / (SAMPLES_PER_CYCLE * frequency))

    def drive(volts: float) -> int:
        sine = np.array([-1j * volts])
        rig.set_voltage(Periodic(0.0, round(frequency * HERTZ), clock.now_ns(), 0, np.array([1]), sine))
        return rig.set_at_ns

    for before, load in zip((0.0, *loads), loads, strict=False):
        set_ns = []
        if load == before:
            set_ns.append(drive(0.0))
            clock.wait(1 / frequency)
        set_ns.append(drive(load / 2 / abs(rig.transfer(frequency)[-1])))
        clock.wait(SETTLED)
        first = -(-clock.now_ns() // period_ns)
        time_ns = (first + np.arange(round(dwell * 1e9 / period_ns))) * period_ns
        path, why = path_of(moves(rig, int(time_ns[-1])), steady=False)
        if path != CLOSED_FORM:
            raise RangeError(f"scene {scene.name!r} has no closed form under {load:g} N: {why}; take how = 'bench'")
        yield SettledLoad(load, rig, time_ns, period_ns, tuple(set_ns))
        clock.wait(dwell)
