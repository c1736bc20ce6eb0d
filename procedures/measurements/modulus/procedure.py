"""Young modulus of a sample: the micro-positioner compresses it on a rigid support (thesis 5.3, Tables 5.2, 5.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from palpate.drivers.bench import Bench
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.contracts import positioner
from palpate.instrument.errors import DeviceError, RangeError, SafetyError, UnreachableError
from palpate.instrument.findings.compression import LOADING, POSITION_STEP, UNLOADING, Compression, compress
from palpate.instrument.findings.load_line import LEAST_POINTS, Floats, Series
from palpate.instrument.quantity import show
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.instrument.uncertainty.propagation import Propagated
from palpate.procedures.engine.progress import Progress
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import (
    READING_INTERVAL,
    TRACK_SETTLING,
    check_zero,
    finish,
    preload,
    steady,
    withdraw,
)

PROCEDURE = "test-modulus"
TRAVEL = positioner.CONTRACT["target"].maximum or math.inf  # m
LARGEST_STRAIN = 0.6
LARGEST_STEPS = 100
LEAST_LOAD = 4.0  # steps of the indicator, at the largest strain
DISPLAYS = 10  # at each position
BARE = (0.05, 0.6)  # of the force limit, between which the bare support is pressed
AREA_U = 0.01  # of the area: 0.05 mm on each edge of 10 mm [A]
BARE_SUPPORT = "bare"
NAMES = (
    ("tangent_modulus", "Pa"), ("secant_modulus", "Pa"), ("unloading_modulus", "Pa"), ("thickness", "m"),
    ("bench_compliance", "m_per_N"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class ModulusSettings:
    """What to test: name of the sample, largest strain, and in how many equal steps.

    extrapolate: loads above the calibrated range are allowed, and marked.
    """

    sample: str
    strain: float
    steps: int
    extrapolate: bool = False


@dataclass(frozen=True, slots=True)
class ModulusResult:
    sample: Sample
    compression: Compression

    def results(self) -> tuple[Propagated, ...]:
        """In the order of NAMES."""
        c = self.compression
        return c.tangent, c.secant, c.unloading, c.thickness, c.compliance

    def summary(self) -> dict[str, Any]:
        """Results under their public names. linearity and energy_loss are fractions."""
        public: dict[str, Any] = {"sample": self.sample.name}
        for (name, unit), found in zip(NAMES, self.results(), strict=True):
            public |= {f"{name}_{unit}": found.value, f"{name}_u": found.u}
        return {
            **public,
            "linearity": self.compression.linearity,
            "energy_loss": self.compression.energy_loss.value,
            "energy_loss_u": self.compression.energy_loss.u,
            "thesis_modulus_Pa": self.sample.modulus,
        }


def check(settings: ModulusSettings, force_limit: float) -> None:
    """Refuse what cannot be done, before any device is spoken to.

    Raises:
        UnknownName: an unknown sample.
        RangeError: strain or steps out of their limits, a pad or deflection beyond the positioner's travel, a force
            beyond the limit in N.
    """
    sample = get_sample(settings.sample)
    if not 0 < settings.strain <= LARGEST_STRAIN:
        raise RangeError(
            f"strain {settings.strain:g} is outside 0 to {LARGEST_STRAIN:g}; give one inside, such as 30 %"
        )
    if not LEAST_POINTS <= settings.steps <= LARGEST_STEPS:
        raise RangeError(
            f"{settings.steps} steps do not give a line with its uncertainty; take {LEAST_POINTS} to {LARGEST_STEPS}"
        )
    if not sample.thickness <= TRAVEL:
        raise RangeError(
            f"sample {sample.name!r} is {show(sample.thickness, 'm')} thick, beyond the positioner's travel of"
            f" {show(TRAVEL, 'm')}; test a thinner pad"
        )
    force = _force(sample, settings.strain)
    if force > force_limit:
        raise RangeError(
            f"strain {settings.strain:g} of sample {sample.name!r} takes about {force:.3g} N, above the bench's force"
            f" limit of {force_limit:g} N; strains up to {settings.strain * force_limit / force:.2g} are possible"
        )


def run(
    bench: Bench, calibration: LoadCellCalibration, settings: ModulusSettings, record: Recorder, progress: Progress
) -> ModulusResult:
    """Press the bare support, then the sample on it down and up again. Each point is durable before `progress` hears.

    Raises:
        RangeError, UnknownName: as `check`, or a load beyond the calibrated range; nothing has moved.
        UnreachableError: a load too small for the indicator, or the positioner ends before the largest strain.
        SafetyError: the force passes the bench's limit; the probe is home again.
        DeviceError, LinkError, BenchError: the bench could not; points stay on disk.
        EstimateError: the readings give no modulus.
    """
    check(settings, bench.force_limit)
    sample = get_sample(settings.sample)
    force = _force(sample, settings.strain)
    if force < LEAST_LOAD * calibration.resolution():
        least = settings.strain * LEAST_LOAD * calibration.resolution() / force
        raise UnreachableError(
            f"strain {settings.strain:g} of sample {sample.name!r} gives about {show(force, 'N', 3)}, below"
            f" {LEAST_LOAD:g} steps of the strain indicator; ask for {least:.2g} or more"
        )
    if force > calibration.greatest_N and not settings.extrapolate:
        calibration.check_range(force)
    series = _Measurement(bench, calibration, record, progress, total=3 * settings.steps)
    withdraw(bench)
    check_zero(bench, calibration)

    bench.operator.lay_on_support(None)
    (first, light), (last, heavy) = (series.press(share * bench.force_limit) for share in BARE)
    bare = series.take(BARE_SUPPORT, np.linspace(first, last, settings.steps))
    compliance = (last - first) / (heavy - light)
    support = first - light * compliance

    withdraw(bench)
    bench.operator.lay_on_support(sample)
    yielding = 1 + compliance * sample.modulus * sample.area / sample.thickness
    deflections = sample.thickness * settings.strain * np.arange(1, settings.steps + 1) / settings.steps
    positions = support - sample.thickness + deflections * yielding
    if positions[-1] > bench.positioner.travel():
        raise UnreachableError(
            f"strain {settings.strain:g} of sample {sample.name!r} needs the positioner at {show(positions[-1], 'm')},"
            f" which ends at {show(bench.positioner.travel(), 'm')}; ask for a smaller strain or raise the support"
        )
    loading = series.take(LOADING, positions)
    unloading = series.take(UNLOADING, positions[::-1])
    finish(bench, calibration)
    area_u = AREA_U * sample.area
    return ModulusResult(sample, compress(bare, loading, unloading, calibration, sample.area, area_u))


@dataclass
class _Measurement:
    """Points of one test, counted over its series."""

    bench: Bench
    calibration: LoadCellCalibration
    record: Recorder
    progress: Progress
    total: int
    done: int = 0

    def press(self, force: float) -> tuple[float, float]:
        """Position [m] and load [N] where the probe presses with about this force [N]."""
        what = f"preload of {show(force, 'N')} on the bare support"
        load = carry_out(self.bench, what, lambda: preload(self.bench, self.calibration, force))
        return self.bench.positioner.position(), load

    def take(self, series: str, positions: Floats) -> Series:
        """Displays at each of the positions [m], one after the other."""
        positions, displays = np.round(positions / POSITION_STEP) * POSITION_STEP, []
        for position in positions:
            what = f"{series}, {1e3 * position:.3f} mm"
            self.progress(self.done, self.total, what)
            shown = carry_out(self.bench, what, partial(self._pressed, float(position)))
            displays.append(shown)
            point = {
                "series": series,
                "position_m": float(position),
                "reading_mV": math.fsum(shown) / len(shown),
                "readings_mV": shown,
                "incidents": self.bench.incidents.new(),
            }
            self.record.point(point, {}, self.bench.clock.now_ns())
            self.done += 1
            self.progress(self.done, self.total, what)
        return Series(positions, np.array(displays))

    def _pressed(self, position: float) -> list[float]:
        """Displays at a position [m]."""
        self.bench.positioner.move(position)
        self.bench.clock.wait(TRACK_SETTLING)
        shown = []
        for number in range(DISPLAYS):
            if number:
                self.bench.clock.wait(READING_INTERVAL)
            reading = steady(self.bench, self._within_limit)
            if not reading.valid:
                name = self.bench.indicator.name
                self.bench.positioner.home()
                raise DeviceError(f"{name}: no valid reading; check the bridge and the support", device=name)
            self._within_limit(reading.reading_mV)
            shown.append(reading.reading_mV)
        return shown

    def _within_limit(self, reading_mV: float) -> None:
        """Raises SafetyError, with the probe home, where a display tells of more force than the bench may take."""
        if not self.calibration.load(reading_mV)[0] <= self.bench.force_limit:
            self.bench.positioner.home()
            raise SafetyError(
                f"{reading_mV:g} mV is more than the bench's force limit of {self.bench.force_limit:g} N;"
                " the probe is home again. Ask for a smaller strain"
            )


def _force(sample: Sample, strain: float) -> float:
    """What the strain should take, by the sample's modulus on file [N]."""
    return sample.modulus * sample.area * strain
