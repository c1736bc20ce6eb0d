"""Settings that several procedures have."""

from __future__ import annotations

from typing import Annotated

from palpate.procedures.engine.settings import Setting

SampleName = Annotated[str, Setting(help="Rubber sample.")]
PeakLoad = Annotated[float, Setting("N", "Load, peak to peak.")]
PeakLoads = Annotated[tuple[float, ...], Setting("N", "Loads, peak to peak.")]
LoadSets = Annotated[tuple[float, ...], Setting("N", "Loads, peak to peak; a repeated one is a set of its own.")]
DwellTime = Annotated[float, Setting("s", "Time over which each point is averaged.")]
Frequency = Annotated[float, Setting("Hz", "Frequency of the load.")]
Extrapolate = Annotated[bool, Setting(help="Let loads pass that lie outside the calibrated range.")]
ValidDays = Annotated[int, Setting(help="Days until the calibration expires.")]
