"""What every effect is: frozen parameters with units, default and source, its kind, and its place in the chain.

The chain's own order, whatever the order in a scene file:

    drive -> shaker -> stack -> films -> source -> amplifier -> input -> converter -> bus
                            `-> cell

Each stage has a class with one method; an effect stands alone in its file and overrides that method.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from palpate.instrument.config import Config
from palpate.instrument.sensor.design import Design, Film

if TYPE_CHECKING:
    from palpate.simulators.bounds.dwells import Dwell
    from palpate.simulators.linear.lti import StateSpace, Times
    from palpate.simulators.physics.parts import Armature, Limits, Plays, Stack
    from palpate.simulators.randomness import Stream
    from palpate.simulators.rig.rig import Rig

Floats = npt.NDArray[np.float64]
Rates = Callable[[], Floats]  # of a film in some phases of the drive (p, n) [V/s]
Kind = Literal["lti", "static_nl", "hysteresis", "additive", "ltv", "timing"]


@dataclass(frozen=True, slots=True)
class Bound:
    """Greatest relative change of a result that leaving an effect out can make; inf where nothing holds."""

    force: float
    ratio: float


@dataclass(frozen=True, slots=True)
class Case:
    """A measurement at a set load that a bound is asked for.

    Attributes:
        frequency: of the drive [Hz].
        dwell: of the least-squares fit [s].
        rate: samples a second.
        settled: how long the drive was on before the dwell [s].
        effects: that the scene simulates, by name.
        driven: a bench with these effects whose drive has just been set for the load.
        follow: what the films of such a bench give over the dwell.
    """

    design: Design
    frequency: float
    dwell: float
    rate: float
    settled: float
    effects: Effects
    driven: Callable[[Effects], Rig]
    follow: Callable[[Effects], Dwell]


class Effect(Config, ABC):
    """One imperfection.

    Its parameters are fields whose defaults carry a mark: [T] thesis, [S] published source, [M] measured,
    [A] assumption. `kind`: `lti`, a gain or a linear system; `static_nl`, a memoryless map; `hysteresis`;
    `additive`, a voltage that adds to the films'; `ltv`, a linear system that changes with time; `timing`, when
    something happens on a bus.
    """

    kind: ClassVar[Kind]
    cancels_in_ratio: ClassVar[bool]
    excludes: ClassVar[Sequence[str]] = ()

    @abstractmethod
    def bound(self, case: Case) -> Bound:
        """Greatest change of the results that leaving the effect out can make."""


Effects = Mapping[str, Effect]


class DriveEffect(Effect, ABC):
    """Changes the frequency that the generator gives."""

    @abstractmethod
    def frequency(self, nominal: int) -> int:
        """Frequency for a nominal one, both integer nHz."""


class ShakerEffect(Effect, ABC):
    """Changes the shaker."""

    @abstractmethod
    def shaker(self, armature: Armature, limits: Limits) -> tuple[Armature, Limits]:
        """The shaker with this effect."""


class StackEffect(Effect, ABC):
    """Changes how object and sensor yield."""

    @abstractmethod
    def stack(self, stack: Stack) -> StateSpace:
        """From the compressions over tooth and ring [m] to the forces on them [N]; neither acts on the other."""


class HysteresisEffect(Effect, ABC):
    """Makes what the films feel depend on what went before."""

    path: str

    @abstractmethod
    def plays(self) -> Plays:
        """Play operators on the force of the films of a kind, `path`."""


class FilmsEffect(Effect, ABC):
    """Changes the films' gains."""

    @abstractmethod
    def matrix(self, design: Design, stream: Stream, set_at_ns: int) -> Floats:
        """What the films' signals are multiplied with, (films, films); `set_at_ns`: when the drive was set."""


class SourceEffect(Effect, ABC):
    """Adds to the films' signals before their amplifiers."""

    @abstractmethod
    def source(self, design: Design, ambient: float = 0.0) -> StateSpace:
        """From tooth force, ring force, the plays' force [N] and the constant 1 to what is added, (films,) [V].

        ambient: so much warmer are the surroundings than they were as the bench was opened [K].
        """


class AmplifierEffect(Effect, ABC):
    """What a film's signal meets first."""

    @abstractmethod
    def system(self, film: Film, design: Design, leakage: float) -> StateSpace:
        """One input, one output, one state, for a conductance across the film [S]."""

    def offset(self, film: Film, design: Design, leakage: float) -> float:
        """Of the output [V]."""
        return 0.0


class LeakEffect(Effect, ABC):
    """A conductance across the films that changes with time."""

    @property
    @abstractmethod
    def epoch_ns(self) -> int:
        """For so long it may be taken as constant."""

    @abstractmethod
    def conductance(self, time: float) -> float:
        """[S] at a time since the bench was opened [s]."""

    @abstractmethod
    def held(self, conductance: float) -> LeakEffect:
        """The same where it always is `conductance` [S]."""

    def middle(self, time: float) -> float:
        """Of the epoch in which a time is [s]."""
        return (round(1e9 * time) // self.epoch_ns + 0.5) * self.epoch_ns * 1e-9


class InputEffect(Effect, ABC):
    """Adds to the voltage at the converter.

    Attributes:
        common: whether it is the same on all channels of a node.
        follows: whether it comes with the rates of the channel's own signal.
    """

    common: ClassVar[bool] = False
    follows: ClassVar[bool] = False

    @abstractmethod
    def volts(self, stream: Stream, time_ns: Times, period_ns: int, rates: Callable[[], Floats]) -> Floats:
        """Voltages at integer multiples of the sample period after the bench was opened, shape (n,).

        rates: gives the rate of the channel's own signal there [V/s].
        """

    @abstractmethod
    def error(self, case: Case, rates: Rates) -> float:
        """Greatest change of a film's amplitude that it makes [V]."""

    @abstractmethod
    def largest(self, case: Case, rates: Rates) -> float:
        """Greatest voltage that it adds to a sample [V]."""

    def dither(self, case: Case) -> float:
        """Standard deviation of what it adds to each sample independently of all others [V]."""
        return 0.0
