"""Results of a study by the numbers of its cells: as a table, as an xarray Dataset, and by group.

results = read_results(Path("runs/studies/softness"))
results.table().groupby("sample").force_ratio.mean()
results.dataset().force_ratio.sel(sample="2").mean("seed")
"""

from __future__ import annotations

import hashlib
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.instrument.additions import library
from palpate.instrument.errors import PalpateError, RecordError, check_path
from palpate.instrument.findings.mean_ratio import mean_ratio
from palpate.instrument.quantity import parse
from palpate.procedures.records.chain import check_holes
from palpate.procedures.records.export import check_format
from palpate.procedures.records.record_file import as_json
from palpate.procedures.records.run import hashable, storing
from palpate.procedures.study.description import Study, StudyFile, Value, parted, study_of
from palpate.procedures.study.run import RECORD, CellOutcome, stored

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

POINTS = "points"
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


@dataclass(frozen=True, slots=True)
class Results:
    """A study and the outcomes of its cells, in their order."""

    study: Study
    outcomes: Sequence[CellOutcome]

    def digest(self) -> str:
        """SHA-256 over the points of all cells, hexadecimal, whatever computed them in whatever order."""
        total = hashlib.sha256()
        for outcome in self.outcomes:  # a reason may name an address, which changes
            total.update(as_json((outcome.cell, bool(outcome.reason), outcome.data)).encode() + b"\n")
        return total.hexdigest()

    def means(self) -> list[CellMean]:
        """Mean of each cell that has an outcome."""
        means = []
        for outcome in self.outcomes:
            points = outcome.points
            valid = [point for point in points if point["valid"]]
            mean = mean_ratio("force ratio", [_RatioPoint(p) for p in valid], None) if valid else None
            means.append(
                CellMean(
                    cell=outcome.cell,
                    axes=self.study.varied(outcome.cell),
                    force_ratio=mean.value if mean else None,
                    force_ratio_u=mean.u if mean else None,
                    model_force_ratio=points[0]["model_force_ratio"] if points else None,
                    valid_points=len(valid),
                    reason=outcome.reason,
                )
            )
        return means

    def groups(self) -> list[SeedGroup]:
        """Groups of cells that agree in everything but the seed."""
        alike: dict[str, list[CellMean]] = {}
        for mean in self.means():
            shared = {name: value for name, value in mean.axes.items() if name != "seed"}
            alike.setdefault(as_json(shared), []).append(mean)
        return [_group(means) for means in alike.values()]

    def table(self) -> pd.DataFrame:
        """One row for each load set of each cell that did not fail.

        Columns are `cell`, `simulated`, one for each axis (quantities have their unit in the name), then the values.
        Lists, as flags, are tuples, by which pandas can group.
        """
        return self._frame(hashable)

    def _frame(self, put: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> pd.DataFrame:
        """The table, with each point as `put` gives it."""
        import pandas as pd

        points = [(outcome.cell, put(point)) for outcome in self.outcomes for point in outcome.points]
        cells = [cell for cell, _ in points]
        axes = {f"{name}_{unit}" if unit else name: values for name, values, unit in self.coordinates(cells)}
        head = pd.DataFrame({"cell": cells, "simulated": [True] * len(cells), **axes})
        return head.join(pd.DataFrame([point for _, point in points]))

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
            axes = [(name, ("cell",), values, unit) for name, values, unit in self.coordinates(range(count))]
        names = [n for n in next((o.points[0] for o in self.outcomes if o.points), {}) if n not in ("flags", "load_N")]
        values = {name: np.full((count, loads), False if name == "valid" else np.nan) for name in names}
        reasons = np.full(count, "not computed", object)
        for outcome in self.outcomes:
            reasons[outcome.cell] = outcome.reason
            for name in names:
                for number, point in enumerate(outcome.points):
                    values[name][outcome.cell, number] = point[name]
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

    def coordinates(self, cells: Sequence[int]) -> list[tuple[str, list[Value], str]]:
        """Name of each axis, the values of these cells on it, and the unit."""
        varied = [self.study.varied(cell) for cell in cells]
        return [(name, *coordinate([each[name] for each in varied])) for name in self.study.axes]

    def export(self, to: str, folder: Path) -> Path:
        """Write the table to `points.<to>`, replacing an older one. Raises RecordError, or as `check_format` does."""
        check_format(to)
        path, frame = folder / f"{POINTS}.{to}", self._frame(dict)
        with storing(path):
            if to == "csv":
                frame.to_csv(path, index=False)
            else:
                frame.to_parquet(path, index=False)
        return path


def read_results(folder: Path) -> Results:
    """Read the results of the study in a folder, also while it runs.

    Raises:
        UsageError: there is none.
        RecordError: it is damaged.
    """
    check_path(folder)
    check_holes(folder / RECORD)
    asked, outcomes = stored(folder)
    try:
        return Results(study_of(StudyFile.model_validate(asked["study"]), str(folder)), outcomes)
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


class _RatioPoint:
    """A stored point, a `mean_ratio.RatioPoint`."""

    def __init__(self, stored: Mapping[str, Any]) -> None:
        self.force_ratio, self.force_ratio_u = float(stored["force_ratio"]), float(stored["force_ratio_u"])
        self.noise_u, self.pickup_u = float(stored["noise_u"]), float(stored["pickup_u"])
        self.calibration_u = 0.0
        self.degrees_of_freedom: float | None = stored["degrees_of_freedom"]


def _group(means: Sequence[CellMean]) -> SeedGroup:
    ratios = [mean.force_ratio for mean in means if mean.force_ratio is not None]
    expected = [mean.model_force_ratio for mean in means if mean.model_force_ratio is not None]
    uncertainties = [mean.force_ratio_u for mean in means if mean.force_ratio_u is not None]
    return SeedGroup(
        axes={name: value for name, value in means[0].axes.items() if name != "seed"},
        cells=len(means),
        failed=sum(bool(mean.reason) for mean in means),
        force_ratio=statistics.fmean(ratios) if ratios else None,
        spread=statistics.stdev(ratios) if len(ratios) > 1 else None,
        force_ratio_u=statistics.fmean(uncertainties) if uncertainties else None,
        model_force_ratio=statistics.fmean(expected) if expected else None,
    )


def _units(name: str) -> dict[str, str]:
    unit = name.rpartition("_")[2]
    return {"units": unit} if unit in UNITS else {}
