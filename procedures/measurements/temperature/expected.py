"""What a temperature sweep is expected to give: the uncertainty of the force ratio's change with temperature.

It is that of the line through the ratios over the changes of temperature, whose points scatter as the design says [M],
with the noise of the films, which is the usual one [A] where none is stated. What a change adds to a film's offset
depends on the films' surroundings: its uncertainty is found by the run alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from palpate.instrument.sensor.design import Design
from palpate.instrument.uncertainty.interpolation import interpolate
from palpate.procedures.engine.promise import Expected
from palpate.procedures.measurements.prospects import expected_mean


def expected_change(design: Design, ratio: float, load: float, dwell: float, steps: Sequence[float]) -> list[Expected]:
    """Uncertainty of the relative change of the ratio [1/K].

    Args:
        design: design of the sensor.
        ratio: expected force ratio of the sample.
        load: load, peak to peak [N].
        dwell: dwell of each point [s].
        steps: the changes of temperature [K].
    """
    point = expected_mean("point", design, ratio, [load], [dwell])
    line = interpolate(steps, [0.0] * len(steps), point.u / point.value)
    return [Expected("change of the force ratio with a trend", math.sqrt(line.covariance[1, 1]), "1/K")]
