"""The base of every effect: frozen parameters with units, defaults and sources, a kind, and a bound on its changes."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from palpate.instrument.arrays import Floats
from palpate.instrument.sensor.design import Design
from palpate.simulators.numbers import Numbers

if TYPE_CHECKING:
    from palpate.simulators.physics.dwells import DrivenBench, SimulatedDwell

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
