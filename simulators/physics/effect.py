"""The base of every effect: frozen parameters with units, defaults and sources, a kind, and a bound on its changes."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.numbers import Numbers

if TYPE_CHECKING:
    from palpate.instrument.arrays import Times
    from palpate.simulators.linear.lti import StateSpace
    from palpate.simulators.physics.chain import Armature, Limits, Plays, SpringStack
    from palpate.simulators.physics.dwells import DrivenBench, SimulatedDwell
    from palpate.simulators.randomness import Stream


# --- the base ------------------------------------------------------------------------------------------


Rates = Callable[[], Floats]  # returns rates (p, n) [V/s] of a film in some phases of the drive
Kind = Literal["lti", "static_nl", "hysteresis", "additive", "ltv", "timing"]


@dataclass(frozen=True, slots=True)
class Bound:
    """Greatest relative change of a result when an effect is left out; inf where there is no bound."""

    force: float
    ratio: float


@dataclass(frozen=True, slots=True)
class Case:
    """A measurement at a set load, for which a bound is asked.

    Attributes:
        frequency: frequency of the drive [Hz].
        dwell: dwell of the least-squares fit [s].
        rate: samples a second.
        settled: time for which the drive was on before the dwell [s].
        effects: simulated effects by name.
        driven: function that gives a bench with some effects, whose drive has just been set for the load.
        follow: function that gives the films of such a bench over the dwell.
    """

    design: Design
    frequency: float
    dwell: float
    rate: float
    settled: float
    effects: Mapping[str, Effect]
    driven: Callable[[Mapping[str, Effect]], DrivenBench]
    follow: Callable[[Mapping[str, Effect]], SimulatedDwell]


class Effect(Numbers):
    """One imperfection.

    Its parameters are fields whose defaults carry a mark: [T] thesis, [S] published source, [M] measured,
    [A] assumption. What others ask of every effect is answered here for one that has no part in it; an effect that has
    answers in its own file.

    Attributes:
        name: its name in scene files: the class name in small letters, with underscores between words.
        kind: `lti`, a gain or a linear system; `static_nl`, a memoryless map; `hysteresis`; `additive`, a voltage that
            adds to the films'; `ltv`, a linear system that changes with time; `timing`, when something happens on a
            bus.
        excludes: names of effects that cannot stand beside it.
        moves: the field of `Touch` that its transitions change; empty: it makes none.
    """

    name: ClassVar[str]
    kind: ClassVar[Kind]
    cancels_in_ratio: ClassVar[bool]
    excludes: ClassVar[Sequence[str]] = ()
    moves: ClassVar[str] = ""

    def __init_subclass__(cls, **config: Any) -> None:
        super().__init_subclass__(**config)
        cls.name = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()

    @property
    def pickup(self) -> float:
        """The share of the load that it adds to the force which each film seems to feel."""
        return 0.0

    def noise_density(self, frequency: float) -> float:
        """Amplitude density of the noise that it adds to a film near a frequency [Hz], one-sided [V/√Hz]."""
        return 0.0

    def dither(self, rate: float) -> float:
        """Standard deviation of what it adds to each sample independently of all others [V], at samples a second."""
        return 0.0

    def nearer(self, share: float) -> Effect | None:
        """The same limit at a share of the quantity that it limits; None: it is no limit."""
        return None

    def known_bound(self, case: Case) -> Bound | None:
        """Greatest change by leaving it out, where that is known without following the scene; else None."""
        return None


# --- places in the chain -------------------------------------------------------------------------------

#     drive -> shaker -> share -> stack -> films -> source -> amplifier -> input -> converter -> can
#                                      `-> cell -> line
#
# Each place has a class; an effect stands alone in its file and overrides that class's methods.


class DriveEffect(Effect, ABC):
    """Changes the generator's frequency."""

    @abstractmethod
    def frequency(self, nominal: int) -> int:
        """Frequency in place of the nominal one, both in integer nHz."""


class ShakerEffect(Effect, ABC):
    """Changes the shaker."""

    @abstractmethod
    def shaker(self, armature: Armature, limits: Limits) -> tuple[Armature, Limits]:
        """The shaker with this effect."""


class ShareEffect(Effect, ABC):
    """Changes the share of the force that the teeth take under an object, which is the sensor's force ratio."""

    @property
    @abstractmethod
    def reach(self) -> tuple[float, float]:
        """Least and greatest change of the ratio's natural logarithm; of what is drawn, within six deviations."""

    @abstractmethod
    def ln_change(self, sample: Sample, stream: Stream, mounted_at_ns: int) -> float:
        """Change of the ratio's natural logarithm, for an object that was mounted at a clock time [ns]."""


class StackEffect(Effect, ABC):
    """Changes the springs of object and sensor."""

    @abstractmethod
    def stack(self, stack: SpringStack) -> StateSpace:
        """System from the compressions over tooth and ring [m] to the forces on them [N]; neither acts on the other."""


class HysteresisEffect(Effect, ABC):
    """Makes the films' force depend on its history."""

    path: str

    @abstractmethod
    def plays(self) -> Plays:
        """Play operators on the force of the films of a kind, `path`."""


class FilmsEffect(Effect, ABC):
    """Changes the films' gains."""

    @property
    def scatter(self) -> float | None:
        """Spread of gains that are drawn anew, over the design's own spread; None: gains stay."""
        return None

    @property
    def by_mounting(self) -> bool:
        """Whether gains are drawn anew for each mounting, not for each load set."""
        return False

    @abstractmethod
    def matrix(self, design: Design, stream: Stream, set_at_ns: int) -> Floats:
        """Matrix (films, films) by which the films' signals are multiplied.

        `set_at_ns` is the clock time at which the drive was set or, where gains are drawn `by_mounting`, at which the
        object was mounted.
        """


class SourceEffect(Effect, ABC):
    """Adds to the films' signals before their amplifiers."""

    @abstractmethod
    def source(self, design: Design, ambient: float = 0.0) -> StateSpace:
        """System from tooth force, ring force, plays' force [N] and the constant 1 to added voltages (films,) [V].

        `ambient` is how much warmer the surroundings are than when the bench was opened [K].
        """


class AmplifierEffect(Effect, ABC):
    """The amplifier of a film's signal."""

    @abstractmethod
    def system(self, film: Film, design: Design, leakage: float) -> StateSpace:
        """System with one input, one output and one state, for a conductance across the film [S]."""

    def offset(self, film: Film, design: Design, leakage: float) -> float:
        """Offset of the output [V]."""
        return 0.0


class LeakEffect(Effect, ABC):
    """A conductance across the films that changes with time."""

    @property
    @abstractmethod
    def epoch_ns(self) -> int:
        """Time for which the leak may be taken as constant [ns]."""

    @abstractmethod
    def conductance(self, time: float) -> float:
        """Conductance [S] at a time since the bench was opened [s]."""

    @abstractmethod
    def held(self, conductance: float) -> LeakEffect:
        """The same leak with a constant conductance [S]."""

    def middle(self, time: float) -> float:
        """Middle of the epoch that holds a time [s]."""
        return (round(1e9 * time) // self.epoch_ns + 0.5) * self.epoch_ns * 1e-9


class InputEffect(Effect, ABC):
    """Adds to the voltage at the converter.

    Attributes:
        common: whether it is the same on all channels of a node.
        follows: whether it is proportional to the rate of the channel's own signal.
    """

    common: ClassVar[bool] = False
    follows: ClassVar[bool] = False

    @abstractmethod
    def volts(self, stream: Stream, time_ns: Times, period_ns: int, rates: Callable[[], Floats]) -> Floats:
        """Voltages (n,) [V] at integer multiples of the sample period after the bench was opened.

        `rates` gives the rate of the channel's own signal there [V/s].
        """

    @abstractmethod
    def error(self, case: Case, rates: Rates) -> float:
        """Greatest change of a film's amplitude that it makes [V]."""

    @abstractmethod
    def largest(self, case: Case, rates: Rates) -> float:
        """Greatest voltage that it adds to a sample [V]."""


class ConverterEffect(Effect, ABC):
    """The converter of the sensor nodes. `bits` is the number of bits of a sample."""

    bits: int

    @abstractmethod
    def convert(self, fraction: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
        """Converted samples and saturation flags of samples given as a fraction of the range."""


class CanEffect(Effect, ABC):
    """Timing of frames on the CAN bus. `bitrate` is that of the bus [bit/s]."""

    bitrate: float

    @abstractmethod
    def burst(self, frames: Sequence[tuple[int, int]], period_ns: int) -> tuple[list[int], int]:
        """Order of the frames, each given by identifier and size, that pass after a SYNC before the next one.

        Returns:
            The places of these frames in `frames`, and the time from the SYNC until the bus is free again [ns].
        """

    @abstractmethod
    def transfer_ns(self) -> int:
        """Time that request and answer of an SDO take [ns]."""


class LineEffect(Effect, ABC):
    """Timing of characters on the serial line. `baudrate` is that of the line [bit/s]."""

    baudrate: float

    @abstractmethod
    def frame(self, size: int) -> float:
        """Time that a frame of `size` bytes takes, with the silence after it [s]."""


class CellEffect(Effect, ABC):
    """What the strain indicator shows and gives of the force on the load cell."""

    @property
    @abstractmethod
    def digits(self) -> int:
        """Decimals of the display."""

    @abstractmethod
    def crept(self, force: float, placed: Sequence[tuple[int, float]], now_ns: int) -> float:
        """Force [N] that the cell feels. `placed` holds when dead weights were changed [ns] and by how much [N]."""

    @abstractmethod
    def in_position(self, degrees: float) -> float:
        """Sensitivity [V/N] of the cell when it is turned about its axis."""

    @abstractmethod
    def added_mV(self, stream: Stream, first: int, count: int) -> Floats:
        """Zero offset and noise (count,) at updates of a display, or samples of an output, from a number on [mV]."""

    @abstractmethod
    def display(self, ideal_mV: float, stream: Stream, update: int) -> float:
        """Reading [mV] at the display's update number `update`, of a bridge whose ideal reading is `ideal_mV`."""


# Each effect inherits from one of these places in the chain; else it would do nothing.
PLACES = (
    DriveEffect, ShakerEffect, ShareEffect, StackEffect, HysteresisEffect, FilmsEffect, SourceEffect, AmplifierEffect,
    LeakEffect, InputEffect, ConverterEffect, CanEffect, LineEffect, CellEffect,
)  # fmt: skip


# --- in order ------------------------------------------------------------------------------------------


ONE_ALONE = (
    StackEffect, HysteresisEffect, AmplifierEffect, LeakEffect, ConverterEffect, CanEffect, LineEffect, CellEffect,
)  # fmt: skip


def rival(effect: Effect, among: Mapping[str, Effect]) -> str | None:
    """An effect that cannot stand beside this one: one excludes the other, or only one can act at their place."""
    for name, other in among.items():
        if name == effect.name:
            continue
        if name in effect.excludes or effect.name in other.excludes:
            return name
        if any(isinstance(effect, place) and isinstance(other, place) for place in ONE_ALONE):
            return name
        films = [each for each in (effect, other) if isinstance(each, FilmsEffect) and each.scatter is not None]
        if len(films) > 1:
            return name
    return None


class Effects(Mapping[str, Effect]):
    """Effects by name, in the order in which they were given; and by place, for which nobody else asks for types.

    A place where several may act gives all of them, any other the first one, or None.
    """

    def __init__(self, effects: Mapping[str, Effect]) -> None:
        self._effects = dict(effects)

    def __getitem__(self, name: str) -> Effect:
        return self._effects[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._effects)

    def __len__(self) -> int:
        return len(self._effects)

    def but(self, *others: Effect | None) -> Effects:
        """These effects without some of them."""
        return Effects({name: e for name, e in self.items() if not any(e is other for other in others)})

    def including(self, effect: Effect) -> Effects:
        """These effects and one more, which replaces another of its name."""
        return Effects({**self, effect.name: effect})

    @cached_property
    def drive(self) -> tuple[DriveEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, DriveEffect))

    @cached_property
    def shaker(self) -> tuple[ShakerEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, ShakerEffect))

    @cached_property
    def share(self) -> tuple[ShareEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, ShareEffect))

    @cached_property
    def stack(self) -> StackEffect | None:
        return next((e for e in self.values() if isinstance(e, StackEffect)), None)

    @cached_property
    def plays(self) -> HysteresisEffect | None:
        return next((e for e in self.values() if isinstance(e, HysteresisEffect)), None)

    @cached_property
    def films(self) -> tuple[FilmsEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, FilmsEffect))

    @cached_property
    def scattering(self) -> FilmsEffect | None:
        """The effect that draws the films' gains anew for each load set or mounting."""
        return next((e for e in self.films if e.scatter is not None), None)

    @cached_property
    def source(self) -> tuple[SourceEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, SourceEffect))

    @cached_property
    def leak(self) -> LeakEffect | None:
        return next((e for e in self.values() if isinstance(e, LeakEffect)), None)

    @cached_property
    def amplifier(self) -> AmplifierEffect | None:
        return next((e for e in self.values() if isinstance(e, AmplifierEffect)), None)

    @cached_property
    def input(self) -> tuple[InputEffect, ...]:
        return tuple(e for e in self.values() if isinstance(e, InputEffect))

    @cached_property
    def converter(self) -> ConverterEffect | None:
        return next((e for e in self.values() if isinstance(e, ConverterEffect)), None)

    @cached_property
    def can(self) -> CanEffect | None:
        return next((e for e in self.values() if isinstance(e, CanEffect)), None)

    @cached_property
    def cell(self) -> CellEffect | None:
        return next((e for e in self.values() if isinstance(e, CellEffect)), None)

    @cached_property
    def line(self) -> LineEffect | None:
        return next((e for e in self.values() if isinstance(e, LineEffect)), None)
