"""What procedures share that go from point to point under a load: how they begin, and how a point is kept.

films = begin(bench, design, calibration, settings.loads, settings.frequency)
points = Points[LoadPoint](films, record, progress, total=36)
points.next("sample 1, 2 N")
...                                     # set the load, measure
points.keep(point, measured, "sample 1, 2 N")
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Generic, TypeVar

from palpate.drivers.bench import Bench
from palpate.drivers.roles import SampleChanger
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.sensor.design import Design
from palpate.procedures.console.progress import Progress
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import check_loads, preload_for
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import Films
from palpate.procedures.steps.pause import NOBODY, Pause, pause_here
from palpate.procedures.steps.servo import check_zero, withdraw

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

P = TypeVar("P", bound="DataclassInstance")


def begin(
    bench: Bench,
    design: Design,
    calibration: LoadCellCalibration,
    loads: Sequence[float],
    frequency: float,
    samples: Sequence[str] = (),
    extrapolate: bool = False,
) -> Films:
    """Films set up for loads [N, peak to peak] at a frequency [Hz], the probe home and the load cell at its zero.

    `samples` are the names of those that will be mounted.

    Raises:
        UnreachableError, RangeError: as `check_loads`; the outputs have stayed off.
        UnknownName: the bench's sample changer does not hold one of the samples; the outputs have stayed off.
        BenchError: the unloaded cell does not read its zero, or the bench could not.
    """
    check_loads(loads, calibration, extrapolate)
    if changer := bench.maybe(SampleChanger):
        changer.check_holds(samples)
    films = Films(bench, design, frequency, preload_for(loads) + max(loads) / 2)
    withdraw(bench)
    check_zero(bench, calibration)
    return films


class Points(Generic[P]):
    """The points of a run so far, in `taken`; each is durable before `progress` hears of it."""

    def __init__(
        self,
        films: Films,
        record: Recorder,
        progress: Progress,
        total: int,
        pause: Pause = NOBODY,
        taken: Sequence[P] = (),
    ) -> None:
        """Tell `progress` of `total` points; `taken` were measured before."""
        self._films, self._record, self._progress, self._pause = films, record, progress, pause
        self._total = total
        self.taken = list(taken)

    def tell(self, what: str) -> None:
        """What is done now."""
        self._progress(len(self.taken), self._total, what)

    def next(self, what: str) -> None:
        """Tell of the next point, and rest before it where somebody asks for a pause."""
        self.tell(what)
        pause_here(self._pause, self._films.bench, self._record)

    def keep(self, point: P, measured: FilmPoint, what: str) -> None:
        """Put a point on disk with its waveforms, then tell of it. Raises RecordError."""
        bench = self._films.bench
        self._record.point(asdict(point), measured.waveforms(self._films.design), bench.clock.now_ns())
        self.taken.append(point)
        self.tell(what)
