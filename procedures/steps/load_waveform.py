"""The load as the waveform of the load indicator's output tells it, and how the films lie in phase with it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import EstimateError
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.estimate import SineFit
from palpate.procedures.steps.film_point import loads_differ
from palpate.procedures.steps.films import FilmRecord, LongFilmRecord

LOAD_N, LOAD_U = "load_waveform_N", "load_waveform_u"


def load_columns(
    load: FilmRecord | LongFilmRecord, films: SineFit, design: Design, calibration: LoadCellCalibration
) -> dict[str, float | None]:
    """What the waveform of the load tells of a point, by the names of its columns.

    `load_waveform_N` is the load, peak to peak, and `phase_FILM_deg` tells how far a film is before it;
    `load_waveform_u` and `phase_FILM_u` are their standard uncertainties. All are None where the waveform is clipped or
    no sine.

    Args:
        load: the samples of the load indicator's output.
        films: fit of the films over the same times.
        design: the sensor.
        calibration: calibration of the load cell, which holds for its output as for its display.
    """
    names = [re.sub(r"[^A-Za-z0-9]+", "_", film.name) for film in design.films]
    columns = [LOAD_N, LOAD_U, *(f"phase_{name}_{what}" for name in names for what in ("deg", "u"))]
    if load.clips.any():
        return dict.fromkeys(columns)
    try:
        fit = load.fit(films.frequency, clipped=False)
        newtons, _ = calibration.load(calibration.zero_mV + 2e3 * float(fit.unbiased[0]))
    except EstimateError:
        return dict.fromkeys(columns)
    noise_u = 2e3 * float(fit.amplitude_u[0]) / calibration.sensitivity_mV_per_N
    values = [newtons, math.hypot(noise_u, calibration.curve_u(newtons))]
    for phase, phase_u in zip(films.phase, films.phase_u, strict=True):
        lead = math.remainder(float(phase - fit.phase[0]), 2 * math.pi)
        values += [math.degrees(lead), math.degrees(math.hypot(float(phase_u), float(fit.phase_u[0])))]
    return dict(zip(columns, values, strict=True))


def doubt(columns: Mapping[str, float | None], load: float, load_u: float) -> str:
    """Why the waveform of the load is in doubt, for people; empty: it is not.

    Args:
        columns: what it tells of a point, from `load_columns`.
        load: load by the load indicator, peak to peak [N].
        load_u: its standard uncertainty [N].
    """
    newtons, u = columns.get(LOAD_N), columns.get(LOAD_U)
    if newtons is None or u is None:
        return "the waveform of the load is clipped, or no sine; check the channel of load_channel" if columns else ""
    if not loads_differ(newtons, u, load, load_u):
        return ""
    return (
        f"the waveform of the load gives {newtons:.3g} N, and the load indicator {load:.3g} N; check load_channel, and "
        "that the indicator's output gives the mV that its display shows"
    )
