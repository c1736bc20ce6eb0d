"""Fields that points of several procedures have. Loads and voltages are peak to peak."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from palpate.procedures.records.columns import LAST, Column
from palpate.procedures.showing.text import verdict

ASKED = Column("the load that was asked for", "N", "load\nN", "g")
MEASURED = Column("the measured load", "N", u="load_measured_u")
FREEDOM = Column("degrees of freedom of `noise_u`; null: infinitely many")
SETTLING = Column("how long the films took to settle", "s")
READING = Column("mean of `readings_mV`", "mV")

SampleOf = Annotated[str, Column("name of the sample", head="sample")]
AskedLoad = Annotated[float, ASKED]
Indicator = Annotated[float, Column("reading of the load indicator", "mV", "meter\nmV", "z.1f")]
Readings = Annotated[tuple[float, ...], Column("readings of the load indicator", "mV")]
MeasuredLoad = Annotated[float, MEASURED]
PrintedLoad = Annotated[float, replace(MEASURED, head="load\nN", cell="z.2f")]
ForceRatio = Annotated[float, Column("force ratio of the sensor", "", "force\nratio", "z.4f", u="force_ratio_u")]
ForceRatioU = Annotated[float, Column(head="u", cell="z.4f")]
NoiseU = Annotated[float, Column("part of `force_ratio_u` that comes from noise")]
CalibrationU = Annotated[float, Column("part of `force_ratio_u` that comes from the films' calibration")]
PickupU = Annotated[float, Column("part of `force_ratio_u` that comes from the cables' pick-up")]
Volts = Annotated[tuple[float, ...], Column("voltage of each film, in the design's order", "V", u="voltages_u")]
Valid = Annotated[bool, Column("whether the point is used", head="valid", cell=verdict, after=LAST)]
Flags = Annotated[tuple[str, ...], Column("why the point is not used, or what to know about it")]
Attempts = Annotated[int, Column("number of attempts")]
Incidents = Annotated[int, Column("failures of the bench since the point before that were made good; see the events")]
Dwell = Annotated[float, Column("the dwell", "s")]
Settling = Annotated[float, SETTLING]
Extrapolated = Annotated[bool, Column("whether the load lies outside the load cell's calibrated range")]
LapSeconds = Annotated[
    float | None,
    Column("bench time since the point before, or since the beginning; null: the run has no time to keep", "s"),
]
