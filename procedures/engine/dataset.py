"""A recorded run as an xarray Dataset."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from palpate.instrument.additions import library
from palpate.instrument.errors import ConfigError, UnknownName, UsageError
from palpate.procedures.engine.catalogue import procedure_class
from palpate.procedures.records.columns import columns_of
from palpate.procedures.records.run import Run

if TYPE_CHECKING:
    import xarray as xr

COORDINATES = ("sample", "load_N")  # of points that have them


def as_dataset(run: Run) -> xr.Dataset:
    """The points over the dimension `point`, by their ids, and their waveforms [V] over `index`, all in memory.

    Numbers and texts of the points are variables; sample and load are coordinates. Their attributes tell what is known
    of them: `units`, `long_name`, and in `ancillary_variables` the name of their standard uncertainty. `time_s` is the
    time of a sample since the waveform's first one, over `index` alone if all waveforms have one rate. If waveforms of
    one point have several rates, each has its own time, `NAME_time_s`. Shorter waveforms end in NaN.

    Raises:
        UsageError: xarray is not installed; or two values, waveforms, dimensions or times have the same name.
        RecordError: the run is damaged.
    """
    xarray = library("xarray", "xarray")
    table = run.table()
    table = table.set_index("id") if len(table) else table
    plain = [name for name in table if not table[name].map(lambda value: isinstance(value, tuple)).any()]
    about = _attributes(run)
    columns: dict[str, tuple[object, ...]] = {
        str(name): ("point", table[name].to_numpy(), about.get(str(name), {})) for name in plain if name != "simulated"
    }
    waveforms = list(run.waveforms())
    shape = (len(table), max((waveform.samples.size for waveform in waveforms), default=0))
    volts: dict[str, np.ndarray] = {}
    rates: dict[str, np.ndarray] = {}
    for waveform in waveforms:
        row = table.index.get_loc(waveform.point_id)
        of_film = volts.setdefault(waveform.name, np.full(shape, np.nan, np.float32))
        of_film[row, : waveform.samples.size] = waveform.samples
        rates.setdefault(waveform.name, np.full(shape[0], np.nan))[row] = waveform.rate
    times = _times(rates, shape[1])
    names = Counter(["point", "index", *columns, *volts, *times])
    if twice := [name for name, count in names.items() if count > 1]:
        raise UsageError(
            f"{run.folder}: two of its values, waveforms, dimensions and times are called {twice[0]!r}; use "
            "palpate runs export, which has points and waveforms in files of their own"
        )
    coordinates: dict[str, object] = {"point": table.index.to_numpy()}
    coordinates |= {name: columns[name] for name in COORDINATES if name in columns}
    coordinates |= times
    variables = {name: column for name, column in columns.items() if name not in COORDINATES}
    variables |= {name: (("point", "index"), samples, {"units": "V"}) for name, samples in volts.items()}
    stamps = {
        "procedure": run.procedure,
        "simulated": str(run.simulated).lower(),
        "started": run.started.isoformat(),
    }
    found: xr.Dataset = xarray.Dataset(variables, coordinates, stamps)
    return found


def _attributes(run: Run) -> dict[str, dict[str, str]]:
    """What is known of the values of a run's points; nothing where its procedure is not known here."""
    try:
        columns = columns_of(procedure_class(run.procedure).point)
    except (UnknownName, ConfigError):
        return {}
    found = {
        name: {"units": column.unit, "long_name": column.doc, "ancillary_variables": column.u}
        for name, column in columns.items()
    }
    return {name: {key: text for key, text in each.items() if text} for name, each in found.items()}


def _times(rates: Mapping[str, np.ndarray], length: int) -> dict[str, object]:
    """The times of the samples as coordinates, from the rates of each waveform at each point [Hz]; NaN: it has none."""
    common = np.full(next(iter(rates.values())).shape, np.nan) if rates else np.empty(0)
    for each in rates.values():
        common = np.where(np.isnan(common), each, common)
    if all(np.all(np.isnan(each) | (each == common)) for each in rates.values()):
        rates = {"": common} if rates else {}
    found: dict[str, object] = {}
    for name, each in rates.items():
        time = np.arange(length) / each[:, np.newaxis]
        one = len(np.unique(each)) == 1
        found[f"{name}_time_s" if name else "time_s"] = ("index", time[0]) if one else (("point", "index"), time)
    return found
