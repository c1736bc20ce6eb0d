"""Outcomes of successive cells as columns, as they are computed, stored and read together.

A block is stored as the arrays of an `.npz` file, which `numpy.load` reads by name:

    point.NAME      (cells, loads)  a value of each load set; of a cell that failed they mean nothing
    point.flags     (cells, loads)  bit k: flag number k of `steps/flags.py`
    reason, alone   (cells,)        places in `texts`: why a cell failed, and why it was computed alone
    mean            (cells, 2)      mean force ratio over the valid load sets and its standard uncertainty; NaN: no mean
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.instrument.findings.film_forces import mean_ratio
from palpate.procedures.steps.flags import FLAGS

Column = npt.NDArray[Any]
Floats = npt.NDArray[np.float64]
Rows = Sequence[Mapping[str, Any]]  # the load sets of a cell by the names of their values; `flags` is a list of names

RAISED, VALID, POINT = "flags", "valid", "point."
FEW_CELLS = "few cells share a scene"  # why cells are computed alone where no effect is the cause


@dataclass(frozen=True, slots=True, eq=False)
class CellBlock:
    """Cells from number `first` on.

    Attributes:
        reasons: why each cell failed; empty: it did not.
        alone: why each cell was computed alone, by an effect or FEW_CELLS; empty: it was computed with others.
        columns: values of the load sets by name, each (cells, loads). Those of `RAISED` are bits, one for each flag in
            the order of `FLAGS` from the lowest on.
        means: mean force ratio of each cell and its standard uncertainty (cells, 2); NaN: no load set is valid.
    """

    first: int
    reasons: Sequence[str]
    alone: Sequence[str]
    columns: Mapping[str, Column]
    means: Floats

    def __len__(self) -> int:
        return len(self.reasons)

    @property
    def done(self) -> npt.NDArray[np.bool_]:
        """Which cells did not fail (cells,)."""
        return np.array([not reason for reason in self.reasons], bool)

    def stored(self) -> bytes:
        """The bytes of an `.npz` file."""
        texts = list(dict.fromkeys((*self.reasons, *self.alone)))
        place = {text: number for number, text in enumerate(texts)}
        points: dict[str, Any] = {f"{POINT}{name}": column for name, column in self.columns.items()}
        file = io.BytesIO()
        np.savez(
            file,
            texts=np.array(texts, np.str_),
            reason=np.array([place[text] for text in self.reasons], np.int32),
            alone=np.array([place[text] for text in self.alone], np.int32),
            mean=self.means,
            **points,
        )
        return file.getvalue()

    @classmethod
    def read(cls, first: int, stored: bytes) -> CellBlock:
        """Read what `stored` gave; columns are read when they are asked for.

        Raises ValueError, KeyError, OSError or BadZipFile: it is nothing of that kind.
        """
        arrays = np.load(io.BytesIO(stored), allow_pickle=False)
        texts = arrays["texts"].tolist()
        return cls(
            first,
            reasons=[texts[place] for place in arrays["reason"].tolist()],
            alone=[texts[place] for place in arrays["alone"].tolist()],
            columns=_StoredColumns(arrays),
            means=arrays["mean"],
        )


class _StoredColumns(Mapping[str, Column]):
    """The columns of a block's file. Reading a column takes longer than all it is needed for."""

    def __init__(self, arrays: Mapping[str, Column]) -> None:
        self._arrays = arrays
        self._names = [name[len(POINT) :] for name in arrays if name.startswith(POINT)]

    def __getitem__(self, name: str) -> Column:
        return self._arrays[f"{POINT}{name}"]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class BlockBuilder:
    """Outcomes of successive cells, which come in any order. Cells are counted from the first one of the block."""

    def __init__(self, first: int, cells: int, loads: int) -> None:
        self._first, self._shape = first, (cells, loads)
        self._reasons, self._alone = [""] * cells, [""] * cells
        self._columns: dict[str, Column] = {}

    def failed(self, cell: int, reason: str) -> None:
        """A cell failed."""
        self._reasons[cell] = reason

    def alone(self, cell: int, cause: str) -> None:
        """A cell is computed alone because of an effect, or because of another cause."""
        self._alone[cell] = cause

    def rows(self, cell: int, rows: Rows) -> None:
        """The load sets of a cell."""
        for name in rows[0]:
            if name != RAISED:
                self._put([cell], name, np.array([_number(row[name]) for row in rows]))
        self._put([cell], RAISED, np.array([_bits(row[RAISED]) for row in rows], np.uint16))

    def arrays(self, cells: Sequence[int], columns: Mapping[str, Column], flags: Mapping[str, Column]) -> None:
        """The load sets of some cells: values by name, and whether each flag is raised; each (cells, loads)."""
        for name, column in columns.items():
            self._put(cells, name, column)
        bits: Column = np.zeros((len(cells), self._shape[1]), np.uint16)
        for flag, raised in flags.items():
            bits |= raised * np.uint16(_bits([flag]))
        self._put(cells, RAISED, bits)

    def _put(self, cells: Sequence[int], name: str, column: Column) -> None:
        if name not in self._columns:
            self._columns[name] = np.zeros(self._shape, column.dtype)
        self._columns[name][cells] = column

    def block(self) -> CellBlock:
        """All cells, with their means."""
        means = np.full((self._shape[0], 2), np.nan)
        if self._columns:
            judged = zip(
                self._columns[VALID].tolist(), *(self._columns[name].tolist() for name in MEASURED), strict=True
            )
            for cell, (reason, (valid, *values)) in enumerate(zip(self._reasons, judged, strict=True)):
                points = [RatioOfLoad(*point) for used, *point in zip(valid, *values, strict=True) if used]
                if points and not reason:
                    mean = mean_ratio("force ratio", points, None)
                    means[cell] = mean.value, mean.u
        return CellBlock(self._first, self._reasons, self._alone, self._columns, means)


@dataclass(frozen=True, slots=True)
class RatioOfLoad:
    """A load set of a cell, a `mean_ratio.RatioPoint`."""

    force_ratio: float
    force_ratio_u: float
    noise_u: float
    pickup_u: float
    freedom: float  # NaN: infinitely many
    calibration_u: float = 0.0

    @property
    def degrees_of_freedom(self) -> float | None:
        return None if math.isnan(self.freedom) else self.freedom


MEASURED = ("force_ratio", "force_ratio_u", "noise_u", "pickup_u", "degrees_of_freedom")


def _number(value: Any) -> Any:
    """A value of a column; None and infinities are NaN, which a table shows as a missing value."""
    return math.nan if value is None or (isinstance(value, float) and math.isinf(value)) else value


def _bits(flags: Sequence[str]) -> int:
    return sum(1 << number for number, flag in enumerate(FLAGS) if flag in flags)


def flags_of(bits: int) -> list[str]:
    """Names of the flags of a load set."""
    return [flag for number, flag in enumerate(FLAGS) if bits >> number & 1]
