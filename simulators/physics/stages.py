"""The places of effects in the chain, in the chain's own order, whatever the order in a scene file:

    drive -> shaker -> stack -> films -> source -> amplifier -> input -> converter -> can
                            `-> cell -> line

Each place has a class; an effect stands alone in its file and overrides that class's methods.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from palpate.instrument.sensor.design import Design, Film
from palpate.simulators.physics.effect import Case, Effect, Floats, Rates

if TYPE_CHECKING:
    from palpate.simulators.linear.lti import StateSpace, Times
    from palpate.simulators.physics.parts import Armature, Limits, Plays, Stack
    from palpate.simulators.randomness import Stream


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

    @property
    def scatter(self) -> float | None:
        """Spread of gains that each load set draws anew, as a multiple of the design's own; None: they stay."""
        return None

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


class ConverterEffect(Effect, ABC):
    """The converter of the sensor nodes. `bits`: of its samples."""

    bits: int

    @abstractmethod
    def convert(self, fraction: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
        """Converted samples and saturation flags of samples given as a fraction of the range."""


class CanEffect(Effect, ABC):
    """When frames pass on the CAN bus. `bitrate`: of the bus [bit/s]."""

    bitrate: float

    @abstractmethod
    def burst(self, frames: Sequence[tuple[int, int]], period_ns: int) -> tuple[list[int], int]:
        """Which of the frames, of an identifier and a size each, follow a SYNC in time, and in what order.

        Returns:
            their places in `frames`; and when the bus is free again, counted from the SYNC [ns].
        """

    @abstractmethod
    def transfer_ns(self) -> int:
        """The time that request and answer of an SDO take."""


class LineEffect(Effect, ABC):
    """When characters pass on the serial line. `baudrate`: of the line [bit/s]."""

    baudrate: float

    @abstractmethod
    def frame(self, size: int) -> float:
        """The time that a frame of `size` bytes takes with the silence behind it [s]."""


class CellEffect(Effect, ABC):
    """What the strain indicator shows of the force on the load cell."""

    @property
    @abstractmethod
    def digits(self) -> int:
        """Decimals of the display."""

    @abstractmethod
    def crept(self, force: float, placed: Sequence[tuple[int, float]], now_ns: int) -> float:
        """The force [N] that the cell feels, `placed` being when dead weights changed [ns] and by how much [N]."""

    @abstractmethod
    def in_position(self, degrees: float) -> float:
        """Sensitivity of the cell turned about its axis [V/N]."""

    @abstractmethod
    def display(self, ideal_mV: float, stream: Stream, update: int) -> float:
        """The reading in mV at display update number `update` of a bridge that should read `ideal_mV`."""
