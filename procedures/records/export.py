"""Export of a run for other programs: as CSV or Parquet."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from palpate.instrument.additions import library
from palpate.instrument.errors import UnknownName, UsageError, check_path
from palpate.procedures.records.run import Run, frame_of, storing

if TYPE_CHECKING:
    import pandas as pd

FORMATS = ("csv", "parquet")
PARQUET = "parquet"  # a format, and the extra that brings the library


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
        write_frames(file, frames, to)


def write_frames(file: BinaryIO, frames: Iterator[pd.DataFrame], to: str) -> None:
    """Write the parts of a table, one after the other, in a format that `check_format` has checked."""
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
