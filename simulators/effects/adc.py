"""The converter of a sensor node: steps and a rail."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from instrument.contracts.sensor_node import RANGE_VOLTS
from instrument.design import Film
from simulators.converter import FINEST, convert
from simulators.effects.effect import Bound, Case, Effect, Floats, Kind
from simulators.planning.changes import of_source
from simulators.planning.pickup import SIGMAS, largest_within, signal, spread

TERMS = 20  # of the Fourier series of a step's error
MARGIN = 0.5  # of the range, up to which a film's nominal peak is taken for far from the rail


class Adc(Effect):
    """Rounds to 2**bits steps over plus and minus the range, and saturates with a flag.

    Without this effect the samples are still rounded to the 16 bits that travel on the bus, and end at their rail.
    """

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = False

    # 16 bit [A]
    bits: int = Field(default=16, ge=4, le=FINEST, strict=True)

    def convert(self, fraction: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
        """Converted samples and saturation flags of samples given as a fraction of the range."""
        return convert(fraction, self.bits)

    def error(self, case: Case, film: Film) -> float:
        """What rounding makes of an amplitude [V]; without limit where the film may reach the rail.

        Half a step of the wide range in every sample. White noise dithers: of the steps' mean error no more is left
        than its Fourier series with each term damped by the noise, and the rest is as independent as the noise is.
        """
        peak = signal(case, film) * (1 + case.preload / case.amplitude)
        if peak > MARGIN * max(RANGE_VOLTS):
            return math.inf
        step = 2 * max(RANGE_VOLTS) / 2.0**self.bits
        noise = getattr(case.effects.get("white_noise"), "density", 0.0) * math.sqrt(case.rate / 2)
        terms = range(1, TERMS + 1)
        mean = sum(math.exp(-2 * (math.pi * k * noise / step) ** 2) / (math.pi * k) for k in terms) * step
        dithered = mean * largest_within(case) + SIGMAS * spread(case) * step / 2
        return min(step / 2 * largest_within(case), dithered)

    def bound(self, case: Case) -> Bound:
        """Against samples that are not rounded at all."""
        return of_source(case, self)
