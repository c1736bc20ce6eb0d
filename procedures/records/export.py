"""Export of a run for other programs: as CSV, Parquet or an xarray Dataset."""

from __future__ import annotations

import contextlib
import itertools
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from palpate.instrument.errors import UnknownName, UsageError, check_path
from palpate.instrument.extras import library
from palpate.procedures.records.run import Run, frame_of, storing

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

FORMATS = ("csv", "parquet")
PARQUET = "parquet"  # a format, and the extra that brings the library
COORDINATES = ("sample", "load_N")  # of points that have them


def check_format(to: str) -> None:
    """Check a format. Raises UnknownName: there is no such format; UsageError: the library for it is not installed."""
    if to not in FORMATS:
        raise UnknownName("export format", to, FORMATS)
    if to == PARQUET:
        library("pyarrow", PARQUET)


def export(run: Run, to: str, folder: Path) -> list[Path]:
    """Writes the points, and the waveforms if the run has any, and returns the files.

    `points.<to>` has the columns of `Run.table`, with lists as lists. `waveforms.<to>` has a row for each sample:
    `point`, `name`, `time_s` (from the waveform's first sample), `value_V` and `simulated`.

    Args:
        to: "csv" or "parquet".
        folder: made with its parents where it does not exist.

    Raises:
        UnknownName: another format.
        UsageError: one of the files exists, or the library that writes them is not installed.
        RecordError: the run is damaged or the files cannot be written. None is left then.
    """
    check_format(to)
    check_path(folder)
    points, waveforms = folder / f"points.{to}", folder / f"waveforms.{to}"
    for path in (points, waveforms):
        if path.exists():
            raise UsageError(f"{path} exists and is not overwritten; choose another --out")
    table = frame_of(run, run.points())
    frames = _waveform_frames(run)
    first = next(frames, None)
    with storing(folder, "a writable folder with --out"):
        folder.mkdir(parents=True, exist_ok=True)
        with contextlib.ExitStack() as undo:
            _write(points, iter([table]), to, undo)
            if first is not None:
                _write(waveforms, itertools.chain([first], frames), to, undo)
            undo.pop_all()
    return [points] if first is None else [points, waveforms]


def as_dataset(run: Run) -> xr.Dataset:
    """The points over the dimension `point`, by their ids, and their waveforms [V] over `index`, all in memory.

    Numbers and texts of the points are variables; sample and load are coordinates. `time_s` is the time of a sample
    since the waveform's first one, over `index` alone if all waveforms have one rate. If waveforms of one point have
    several rates, each has its own time, `NAME_time_s`. Shorter waveforms end in NaN.

    Raises:
        UsageError: xarray is not installed; or two values, waveforms, dimensions or times have the same name.
        RecordError: the run is damaged.
    """
    xarray = library("xarray", "xarray")
    table = run.table()
    table = table.set_index("id") if len(table) else table
    plain = [name for name in table if not table[name].map(lambda value: isinstance(value, tuple)).any()]
    columns: dict[str, tuple[object, ...]] = {
        str(name): ("point", table[name].to_numpy()) for name in plain if name != "simulated"
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


def _waveform_frames(run: Run) -> Iterator[pd.DataFrame]:
    """One long table for each point, because a long run does not fit into memory at once."""
    import pandas as pd

    for point_id, waveforms in itertools.groupby(run.waveforms(), key=lambda waveform: waveform.point_id):
        yield pd.concat(
            pd.DataFrame(
                {
                    "point": point_id,
                    "name": waveform.name,
                    "time_s": np.arange(waveform.samples.size) / waveform.rate,
                    "value_V": waveform.samples,
                    "simulated": run.simulated,
                }
            )
            for waveform in waveforms
        )


def _write(path: Path, frames: Iterator[pd.DataFrame], to: str, undo: contextlib.ExitStack) -> None:
    with path.open("xb") as file:
        undo.callback(path.unlink)
        {"csv": _write_csv, "parquet": _write_parquet}[to](file, frames)


def _write_csv(file: BinaryIO, frames: Iterator[pd.DataFrame]) -> None:
    for index, frame in enumerate(frames):
        frame.to_csv(file, index=False, header=index == 0)


def _write_parquet(file: BinaryIO, frames: Iterator[pd.DataFrame]) -> None:
    pa, pq = library("pyarrow", PARQUET), library("pyarrow.parquet", PARQUET)
    with contextlib.ExitStack() as stack:
        writer = None
        for frame in frames:
            table = pa.Table.from_pandas(frame, preserve_index=False)
            if writer is None:
                writer = stack.enter_context(pq.ParquetWriter(file, table.schema))
            writer.write_table(table)
