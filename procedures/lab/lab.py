"""What a procedure is given: what is known of a bench before it is opened, and the open bench that it measures with."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime

from palpate.drivers.bench import Bench
from palpate.drivers.roles import SensorNode
from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.sensor.design import Design


@dataclass(frozen=True, slots=True)
class Target:
    """What is known of a bench before it is opened: its sensor, its force limit in N, how many sensor nodes it has.

    `model`: by which a simulated one answers; None: it may be real.
    """

    design: Design
    force_limit: float
    nodes: int
    model: str | None = None


@dataclass(frozen=True, slots=True)
class Lab:
    """An open bench and what a procedure needs to know of it.

    Attributes:
        design: of the sensor, with the sensitivities of `films` where they are calibrated.
        calibration: of the load cell.
        films: calibration of the films; None: the design's own sensitivities serve.
        run: name of the run that is recorded; "": none is.
        started: when it began.
    """

    bench: Bench
    design: Design
    calibration: LoadCellCalibration
    films: FilmCalibration | None = None
    run: str = ""
    started: datetime = field(default_factory=lambda: datetime.now(UTC))

    @property
    def target(self) -> Target:
        """What procedures check their settings against."""
        return Target(self.design, self.bench.force_limit, len(self.bench.all(SensorNode)))
