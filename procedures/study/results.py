"""Results of a study by the numbers of its cells: as a table, as an xarray Dataset, and by group.

results = read_results(Path("runs/studies/softness"))
results.table().groupby("sample").force_ratio.mean()
results.dataset().force_ratio.sel(sample="2").mean("seed")
"""

from __future__ import annotations

import hashlib
import math
import statistics
from array import array
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from palpate.instrument.additions import library
from palpate.instrument.errors import PalpateError, RecordError, check_path
from palpate.instrument.quantity import parse
from palpate.procedures.records.chain import check_holes
from palpate.procedures.records.export import check_format, write_frames
from palpate.procedures.records.record_file import as_json
from palpate.procedures.records.run import storing
from palpate.procedures.showing.figure import new_figure, save
from palpate.procedures.showing.text import MARKS, legend, new_table, number, print_all, stamped
from palpate.procedures.study.description import Axis, Span, Study, StudyFile, Value, parted, study_of
from palpate.procedures.study.run import FEW_CELLS, RAISED, RECORD, VALID, CellBlock, flags_of, stored

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


POINTS = "points"
LOAD, MODEL = "load_N", "model_force_ratio"
UNITS = ("N", "V")  # units at the end of columns' names


@dataclass(frozen=True, slots=True)
class CellMean:
    """Mean of a cell over its valid load sets.

    Attributes:
        axes: value of the cell on each axis.
        force_ratio: mean force ratio; None: no load set is valid. Its standard uncertainty holds gain scatter and
            noise, which are independent in each load set.
        model_force_ratio: force ratio by the scene's model.
        reason: why the cell failed; empty: it did not.
    """

    cell: int
    axes: dict[str, Value]
    force_ratio: float | None
    force_ratio_u: float | None
    model_force_ratio: float | None
    valid_points: int
    reason: str


@dataclass(frozen=True, slots=True)
class SeedGroup:
    """Cells that differ in their seeds alone.

    Attributes:
        axes: values that the cells share.
        force_ratio: mean of the cells' force ratios; None: there are too few.
        spread: standard deviation of the cells' force ratios; None: there are too few.
        force_ratio_u: mean of the cells' standard uncertainties.
    """

    axes: dict[str, Value]
    cells: int
    failed: int
    force_ratio: float | None
    spread: float | None
    force_ratio_u: float | None
    model_force_ratio: float | None


@dataclass(slots=True)
class Tally:
    """Outcomes in numbers.

    Attributes:
        cells: number of cells that have an outcome.
        with_mean: number of cells of which a load set is valid.
        failed: why each cell that failed did.
        one_by_one: why cells were computed one by one, effects or FEW_CELLS, and how many cells for each cause.
    """

    cells: int = 0
    with_mean: int = 0
    failed: dict[int, str] = field(default_factory=dict)
    one_by_one: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True, slots=True)
class Results:
    """A study and the outcomes of its cells in blocks, in the order of the cells. Blocks are read when needed."""

    study: Study
    blocks: Iterable[CellBlock]

    def digest(self) -> str:
        """SHA-256 over the points of all cells, hexadecimal, whatever computed them in whatever order and blocks."""
        totals: defaultdict[str, Any] = defaultdict(hashlib.sha256)
        for block in self.blocks:
            done = block.done  # a reason may name an address, which changes
            totals["cell"].update(np.arange(block.first, block.first + len(block), dtype="<i8").tobytes())
            totals["done"].update(done.tobytes())
            for name, column in block.columns.items():
                totals[name].update(column[done].astype(column.dtype.newbyteorder("<")).tobytes())
        return hashlib.sha256(as_json({name: total.hexdigest() for name, total in totals.items()}).encode()).hexdigest()

    def tally(self) -> Tally:
        """How many cells are known, and what befell them."""
        tally = Tally()
        for block in self.blocks:
            tally.cells += len(block)
            tally.with_mean += int(np.count_nonzero(~np.isnan(block.means[:, 0])))
            tally.failed |= {block.first + at: reason for at, reason in enumerate(block.reasons) if reason}
            tally.one_by_one.update(cause for cause in block.alone if cause)
        return tally

    def means(self) -> Iterator[CellMean]:
        """Mean of each cell that has an outcome."""
        for block in self.blocks:
            valid = block.columns[VALID].sum(axis=1).tolist() if block.columns else [0] * len(block)
            expected = block.columns[MODEL][:, 0].tolist() if block.columns else [math.nan] * len(block)
            for place, reason in enumerate(block.reasons):
                ratio, ratio_u = block.means[place].tolist()
                yield CellMean(
                    cell=block.first + place,
                    axes=self.study.varied(block.first + place),
                    force_ratio=None if math.isnan(ratio) else ratio,
                    force_ratio_u=None if math.isnan(ratio) else ratio_u,
                    model_force_ratio=None if reason else expected[place],
                    valid_points=0 if reason else valid[place],
                    reason=reason,
                )

    def groups(self) -> list[SeedGroup]:
        """Groups of cells that agree in everything but the seed."""
        groups: dict[tuple[Value, ...], _Gathered] = {}
        for mean in self.means():
            shared = {name: value for name, value in mean.axes.items() if name != "seed"}
            key = tuple(shared.values())
            if key not in groups:
                groups[key] = _Gathered(shared)
            groups[key].add(mean)
        return [group.gathered() for group in groups.values()]

    def table(self) -> pd.DataFrame:
        """One row for each load set of each cell that did not fail.

        Columns are `cell`, `simulated`, one for each axis (quantities have their unit in the name), then the values.
        Lists, as flags, are tuples, by which pandas can group.
        """
        import pandas as pd

        return pd.concat(self._frames(tuple), ignore_index=True)

    def _frames(self, listed: Callable[[list[str]], Sequence[str]]) -> Iterator[pd.DataFrame]:
        """The table block by block, with flags as `listed` gives them; where no cell has points, one without rows."""
        import pandas as pd

        units = self._units()
        some = False
        for block in self.blocks:
            places = np.flatnonzero(block.done)
            if not places.size:
                continue
            some = True
            cells, loads = block.first + places, block.columns[RAISED].shape[1]
            values: dict[str, Any] = {name: block.columns[name][places].ravel() for name in sorted(block.columns)}
            shown = {bits: listed(flags_of(bits)) for bits in np.unique(values[RAISED]).tolist()}
            values[RAISED] = [shown[bits] for bits in values[RAISED].tolist()]
            yield pd.DataFrame({**self._head(cells.tolist(), loads, units), **values})
        if not some:
            yield pd.DataFrame(self._head([], 0, units))

    def _head(self, cells: Sequence[int], loads: int, units: Mapping[str, str]) -> dict[str, Any]:
        """The table's columns before the values, for load sets of some cells."""
        import pandas as pd

        head: dict[str, Any] = {"cell": cells, "simulated": [True] * len(cells)}
        head |= {f"{name}_{units[name]}" if units[name] else name: values for name, values in self._axes(cells, units)}
        return {name: pd.Series(values).repeat(loads).reset_index(drop=True) for name, values in head.items()}

    def _axes(self, cells: Sequence[int], units: Mapping[str, str]) -> Iterator[tuple[str, list[Value]]]:
        """Name of each axis, and the values of some cells on it, as numbers in their unit where they have one."""
        varied = [self.study.varied(cell) for cell in cells]
        for name, unit in units.items():
            values = [each[name] for each in varied]
            yield name, [parse(str(value), unit) for value in values] if unit else values

    def _units(self) -> dict[str, str]:
        """Unit of each axis: that of the first known cell; empty: its values are no quantities."""
        first = self.study.varied(next((block.first for block in self.blocks), 0))
        return {name: _unit(first[name], axis) for name, axis in self.study.axes.items()}

    def dataset(self) -> xr.Dataset:
        """Values over the axes of a grid, or over `cell` where cells were drawn, and over `load_N`.

        Missing values are NaN.

        Raises:
            UsageError: xarray is not installed.
        """
        xarray = library("xarray", "xarray")
        study, count, loads = self.study, len(self.study), len(self.study.loads)
        if study.file.random is None:
            dims, shape = (*study.axes,), study.shape
            axes = [(name, (name,), *coordinate(list(axis))) for name, axis in study.axes.items()]  # type: ignore[arg-type]
        else:
            dims, shape = ("cell",), (count,)
            units = self._units()
            axes = [(name, ("cell",), values, units[name]) for name, values in self._axes(range(count), units)]
        values: dict[str, npt.NDArray[Any]] = {}
        reasons = np.full(count, "not computed", object)
        for block in self.blocks:
            reasons[block.first : block.first + len(block)] = block.reasons
            places = np.flatnonzero(block.done)
            for name, column in sorted(block.columns.items()):
                if name in (LOAD, RAISED):
                    continue
                if name not in values:
                    values[name] = np.full((count, loads), False if name == VALID else np.nan)
                values[name][block.first + places] = column[places]
        found: xr.Dataset = xarray.Dataset(
            {
                **{
                    name: ((*dims, "load_N"), array.reshape(*shape, loads), _units(name))
                    for name, array in values.items()
                },
                "reason": (dims, reasons.astype(str).reshape(shape)),
            },
            {
                **{name: (on, given, {"units": unit} if unit else {}) for name, on, given, unit in axes},
                "load_N": ("load_N", list(study.loads), {"units": "N"}),
            },
            {"simulated": "true", "study": study.file.name, "how": study.file.how},
        )
        return found

    def export(self, to: str, folder: Path) -> Path:
        """Write the table to `points.<to>`, replacing an older one. Raises RecordError, or as `check_format` does."""
        check_format(to)
        path = folder / f"{POINTS}.{to}"
        with storing(path), path.open("wb") as file:
            write_frames(file, self._frames(list), to)
        return path


def read_results(folder: Path) -> Results:
    """Read the results of the study in a folder, also while it runs.

    Raises:
        UsageError: there is none.
        RecordError: it is damaged.
    """
    check_path(folder)
    check_holes(folder / RECORD)
    asked, blocks = stored(folder)
    try:
        return Results(study_of(StudyFile.model_validate(asked["study"]), str(folder)), blocks)
    except (ValueError, KeyError, PalpateError) as error:
        raise RecordError(f"{folder} holds a study that this version of palpate cannot read: {error}") from error


def coordinate(values: Sequence[Value]) -> tuple[list[Value], str]:
    """Quantities as numbers in the unit of the first one, and that unit; other values as they are, and ""."""
    try:
        if values and all(isinstance(value, str) for value in values):
            unit = parted(values[0])[1]
            return [parse(str(value), unit) for value in values], unit
    except PalpateError:
        pass
    return list(values), ""


def _unit(first: Value, axis: Axis) -> str:
    """Unit of the first cell's value on an axis, if all its values are quantities in such a unit; else empty."""
    if isinstance(axis, Span):
        return axis.unit
    return coordinate([first, *axis])[1] if isinstance(first, str) else ""


class _Gathered:
    """The means of a group's cells so far, as plain numbers: a group may have a million cells."""

    def __init__(self, axes: dict[str, Value]) -> None:
        self._axes = axes
        self._cells = self._failed = 0
        self._ratios, self._uncertainties, self._expected = array("d"), array("d"), array("d")

    def add(self, mean: CellMean) -> None:
        self._cells += 1
        self._failed += bool(mean.reason)
        for numbers, found in (
            (self._ratios, mean.force_ratio),
            (self._uncertainties, mean.force_ratio_u),
            (self._expected, mean.model_force_ratio),
        ):
            if found is not None:
                numbers.append(found)

    def gathered(self) -> SeedGroup:
        return SeedGroup(
            axes=self._axes,
            cells=self._cells,
            failed=self._failed,
            force_ratio=statistics.fmean(self._ratios) if self._ratios else None,
            spread=statistics.stdev(self._ratios) if len(self._ratios) > 1 else None,
            force_ratio_u=statistics.fmean(self._uncertainties) if self._uncertainties else None,
            model_force_ratio=statistics.fmean(self._expected) if self._expected else None,
        )


def _units(name: str) -> dict[str, str]:
    unit = name.rpartition("_")[2]
    return {"units": unit} if unit in UNITS else {}


# --- Report of a study: a line for each group of cells that differ in their seeds alone, and plots over each axis

MOST_LINES, MOST_PANELS, MOST_REASONS = 40, 3, 5
DECADE_AND_MORE = 30.0  # ratio of an axis' ends from which on it is drawn logarithmic


def print_study(results: Results, outcome: dict[str, Any]) -> None:
    """Print groups, failures and files."""
    groups = results.groups()
    names = [name for name in results.study.axes if name != "seed"]
    table = new_table(
        stamped(True, f"{results.study.file.name}: mean force ratio, {results.study.file.how}"),
        *(name.removeprefix("effects.") for name in names), "cells", "failed", "ratio", "spread", "u", "model",
    )  # fmt: skip
    for group in groups[:MOST_LINES]:
        table.add_row(
            *(str(group.axes[name]) for name in names), str(group.cells), str(group.failed or ""),
            *map(number, (group.force_ratio, group.spread, group.force_ratio_u, group.model_force_ratio)),
        )  # fmt: skip
    lines = legend(table, marks=MARKS)
    if len(groups) > MOST_LINES:
        lines.append(f"and {len(groups) - MOST_LINES} lines more in {outcome['points'] or 'the results with --json'}")
    failed = outcome["failed"]
    lines += [f"cell {each['cell']} failed: {each['reason']}" for each in failed[:MOST_REASONS]]
    if len(failed) > MOST_REASONS:
        lines.append(f"and {len(failed) - MOST_REASONS} cells more failed: see --json")
    lines += [
        f"{count} cells were computed one by one, because of "
        + ("how few of them share a scene" if cause == FEW_CELLS else f"the effect {cause}")
        for cause, count in outcome["one_by_one"].items()
    ]
    lines += [
        f"study          {outcome['study']}, {outcome['done']} of {outcome['cells']} cells",
        f"points         {outcome['points'] or 'in study.record; as a table with --to csv or --to parquet'}",
        f"plot           {outcome['plot']}",
    ]
    print_all(table, *lines)


def plot_study(results: Results, folder: Path) -> Path:
    """Draws the mean force ratio of each cell over each axis that varies; returns the PNG."""
    ratios = array("d")
    axes: dict[str, list[Value]] = {name: [] for name in results.study.axes}
    for mean in results.means():
        if mean.force_ratio is not None:
            ratios.append(mean.force_ratio)
            for name, value in mean.axes.items():
                axes[name].append(value)
    varied = [name for name, values in axes.items() if any(str(value) != str(values[0]) for value in values)]
    shown = [name for name in varied if name != "seed"][:MOST_PANELS] or [*results.study.axes][:1]
    figure, panels = new_figure(True, len(shown), f"{results.study.file.name}, {len(ratios)} cells")
    for ax, name in zip(panels, shown, strict=True):
        values, unit = coordinate(axes[name])
        if any(isinstance(value, str) for value in values):
            places = {value: place for place, value in enumerate(dict.fromkeys(values))}
            ax.plot([places[value] for value in values], ratios, "o", ms=3, alpha=0.5)
            ax.set_xticks([*places.values()], [str(value) for value in places], fontsize=7)
        else:
            ax.plot(values, ratios, "o", ms=3, alpha=0.5)
            if values and min(values) > 0 and max(values) > DECADE_AND_MORE * min(values):  # type: ignore[operator]
                ax.set_xscale("log")
        ax.set(xlabel=f"{name} ({unit})" if unit else name, ylabel="mean force ratio")
    return save(figure, folder)
