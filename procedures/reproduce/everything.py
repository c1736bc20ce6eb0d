"""Chapters 4 and 5 of the thesis beside ours: the models, and every experiment on the simulated bench."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from drivers.bench import Bench
from instrument.calibration import THESIS_LOAD_CELL
from instrument.designs import get_design
from instrument.evidence import Evidence, ratio_by
from instrument.sample import SAMPLES
from instrument.thesis import COMPRESSION_TABLES
from procedures import load_cell, load_plan, load_sweep, modulus
from procedures.record import Recorder
from procedures.reproduce import bench_tables, experiments, models, percent
from procedures.reproduce.curves import Progress
from procedures.reproduce.figures.chapter5 import FIGURES
from procedures.reproduce.figures.measured import Measured
from procedures.reproduce.models import Reproduction
from procedures.reproduce.page import write_page
from procedures.reproduce.rows import LEAST_SHARE, Row, RowTable, by_chance, counted
from procedures.reproduce.slips import write_slips

PROCEDURE = "reproduce"
DWELL, FREQUENCY = 1.0, 10.0  # s, Hz
STRAIN, STEPS = 0.3, 10
CREATED = datetime(2026, 1, 1, tzinfo=UTC)


class Recorded(Protocol):
    """An open simulated bench with the record of a run on it."""

    @property
    def bench(self) -> Bench: ...

    @property
    def record(self) -> Recorder: ...

    @property
    def model(self) -> str | None:
        """The sensor model that its force ratios come from; None: nothing is simulated."""


# Scene and procedure -> such a bench; on the way out its run is complete.
Open = Callable[[str, str], AbstractContextManager[Recorded]]


@dataclass(slots=True)
class Everything:
    """What is done so far: the models' part, tables of rows with their files, and the page of all."""

    models: Reproduction
    tables: list[tuple[RowTable, Path]] = field(default_factory=list)
    orders: dict[str, bool] = field(default_factory=dict)
    page: Path | None = None

    def judged(self) -> list[tuple[str, Row]]:
        """Rows that have a stated scatter, with their table."""
        return [(table.number, row) for table, _ in self.tables for row in table.judged] + list(_goals(self.models))

    def outside(self) -> list[tuple[str, Row]]:
        return [(number, row) for number, row in self.judged() if not row.within]

    def met(self) -> bool:
        """Whether as many rows lie within as are asked for, of experiments and of others, and the orders are right.

        One row in twenty is outside by chance: a single one is no failure.
        """
        tables = [table for table, _ in self.tables]
        cells, inside = counted(table for table in tables if table.experimental)
        others = [row.within for table in tables if not table.experimental for row in table.judged]
        others += [row.within for _, row in _goals(self.models) if row.evidence is not Evidence.PREDICTED]
        of_experiments, of_others = inside >= LEAST_SHARE * cells, sum(map(bool, others)) >= LEAST_SHARE * len(others)
        return of_experiments and of_others and all(self.orders.values())

    def summary(self) -> dict[str, Any]:
        """Under public names."""
        experimental = [table for table, _ in self.tables if table.experimental]
        cells, inside = counted(experimental)
        return {
            "judged": len(self.judged()),
            "within": len(self.judged()) - len(self.outside()),
            "experimental_cells": cells,
            "experimental_within": inside,
            "experimental_share": inside / cells if cells else None,
            "experimental_by_chance": by_chance(row for table in experimental for row in table.rows),
            "biased": [table.number for table in experimental if table.biased],
            "softness_order_right": self.orders,
            "met": self.met(),
            "outside": [{"table": number, **row.record()} for number, row in self.outside()],
        }


def run(open_bench: Open, done: Everything, progress: Progress) -> None:
    """Make everything; each table is on disk, and in `done`, before the next begins.

    Raises:
        BenchError, EstimateError: a simulated bench or a model could not. RecordError: a file cannot be written.
    """
    tables = done.tables
    folder = done.models.folder

    def add(found: Iterable[RowTable]) -> None:
        tables.extend((table, table.write(folder)) for table in found)

    sweeps = {}
    for arrangement in experiments.ARRANGEMENTS:
        with open_bench(arrangement.scene, load_plan.PROCEDURE) as session:
            settings = load_plan.SweepSettings(tuple(SAMPLES), arrangement.loads, DWELL, FREQUENCY)
            swept = load_sweep.run(
                session.bench, get_design(arrangement.design), THESIS_LOAD_CELL, settings, session.record, progress
            )
            assert session.model is not None  # of a scene
            ratio = ratio_by(session.model)
        sweeps[arrangement.design] = swept
        done.orders[arrangement.design] = experiments.order_is_right(swept, get_design(arrangement.design))
        add(experiments.compare(arrangement, swept, ratio))
    with open_bench("thesis_single", load_cell.PROCEDURE) as session:
        bench = session.bench.description
        weighed = load_cell.run(session.bench, load_cell.LoadCellSettings(), session.record, progress, CREATED)
    add([bench_tables.calibration(weighed)])
    tested = {}
    for sample, number in COMPRESSION_TABLES.items():
        with open_bench("thesis_single", modulus.PROCEDURE) as session:
            settings_ = modulus.ModulusSettings(sample, STRAIN, STEPS)
            tested[sample] = modulus.run(session.bench, THESIS_LOAD_CELL, settings_, session.record, progress)
        add([bench_tables.compression(number, sample, tested[sample])])
    add([bench_tables.catalogue(tested), percent.errors()])
    curves = models.run(models.SETS, done.models, progress)
    measured = Measured(bench, sweeps, tested)
    done.models.pictures += [draw(measured, models.SETS, curves, folder) for draw in FIGURES.values()]
    write_slips(folder)
    done.page = write_page(done, folder)


def _goals(reproduction: Reproduction) -> Iterable[tuple[str, Row]]:
    """Cells of the models that have a goal: half of it stands for a standard uncertainty."""
    for comparison, _ in reproduction.tables:
        for column in comparison.columns:
            if column.goal is None:
                continue
            for series in column.ours:
                evidence = column.evidence(series, comparison.table)
                for row, cell, ours in zip(comparison.table.rows, column.cells, series.values, strict=True):
                    name = f"{column.quantity} by {series.model}, {series.parameters}"
                    magnitude = type(cell)(cell.printed, abs(cell.value), cell.reason)
                    yield (
                        comparison.table.number,
                        Row(row, name, magnitude, float(ours), column.goal / 2, evidence, measured=False),
                    )
