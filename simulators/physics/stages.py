"""The places of effects in the chain, in the chain's own order, whatever the order in a scene file:

    drive -> shaker -> share -> stack -> films -> source -> amplifier -> input -> converter -> can
                                     `-> cell -> line

Each place has a class; an effect stands alone in its file and overrides that class's methods.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.sensor.design import Design, Film
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.physics.effect import Case, Effect, Rates

if TYPE_CHECKING:
    from palpate.instrument.arrays import Times
    from palpate.simulators.linear.lti import StateSpace
    from palpate.simulators.physics.parts import Armature, Limits, Plays, SpringStack
    from palpate.simulators.randomness import Stream


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
    """The strain indicator's display of the force on the load cell."""

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
    def added_mV(self, stream: Stream, update: int) -> float:
        """Zero offset and noise at an update of a display of that number [mV]."""

    @abstractmethod
    def display(self, ideal_mV: float, stream: Stream, update: int) -> float:
        """Reading [mV] at the display's update number `update`, of a bridge whose ideal reading is `ideal_mV`."""


# Each effect inherits from one of these places in the chain; else it would do nothing.
PLACES = (
    DriveEffect, ShakerEffect, ShareEffect, StackEffect, HysteresisEffect, FilmsEffect, SourceEffect, AmplifierEffect,
    LeakEffect, InputEffect, ConverterEffect, CanEffect, LineEffect, CellEffect,
)  # fmt: skip
