"""Chapters 4 and 5 of the thesis beside ours: the models, and every experiment on the simulated bench."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.models.evidence import of_experiment, ratio_by
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.thesis import COMPRESSION_TABLES
from palpate.procedures.console.terminal import Progress
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.engine.listeners import steps
from palpate.procedures.lab.chosen import choose
from palpate.procedures.lab.lab import Lab
from palpate.procedures.lab.open import opened
from palpate.procedures.lab.session import Session, recording
from palpate.procedures.lab.store import result_folder
from palpate.procedures.measurements.load_cell.procedure import LoadCellSeries
from palpate.procedures.measurements.loads import LoadSweep, SweepResult
from palpate.procedures.measurements.modulus import ModulusTest
from palpate.procedures.records.events import Listener, unheard
from palpate.procedures.reproduce import chapter5, models
from palpate.procedures.reproduce.chapter5 import RATIO, read_traces
from palpate.procedures.reproduce.criterion import write_classes
from palpate.procedures.reproduce.figures import BenchMeasurements, bench_pictures, draw_bridge
from palpate.procedures.reproduce.page import Everything, write_page
from palpate.procedures.reproduce.rows import RowTable, write_slips

PROCEDURE = "reproduce"
SECONDS = 18.0  # s of processor time that `run` takes [M]
DWELL, FREQUENCY = 1.0, 10.0  # s, Hz
STRAIN, STEPS = 0.3, 10
CREATED = datetime(2026, 1, 1, tzinfo=UTC)


@contextmanager
def recorded(
    folder: Path,
    seed: int | None,
    scene: str,
    procedure: str,
    model: str | None = None,
    parameters: str | None = None,
    listener: Listener = unheard,
) -> Iterator[Session]:
    """Open the simulated bench of a scene, and record a run on it in a folder of its own; at the end it is complete.

    Args:
        folder: where the run's folder goes.
        seed: seed of the scene; None: the scene's own.
        model, parameters: sensor model from which force ratios come, and its parameter set; None: the scene's.
        listener: hears of each point.
    """
    taken = sum(1 for path in folder.iterdir() if path.is_dir())
    name = "-".join(part for part in (f"{taken + 1}-{procedure}-{scene}", parameters) if part)
    started = datetime.now(UTC)
    with (
        result_folder(folder / name, procedure, started) as place,
        opened(choose(None, scene, seed, model, parameters), None, started=started) as bench,
        recording(bench, procedure, {}, place, listener=listener) as session,
    ):
        yield session
        session.record.finish("complete", {})


def run(done: Everything, seed: int | None, progress: Progress) -> None:
    """Make everything; each table is on disk, and in `done`, before the next begins.

    Raises:
        BenchError, EstimateError: a simulated bench or a model could not. RecordError: a file cannot be written.
    """
    tables = done.tables
    folder = done.models.folder
    open_bench = partial(recorded, folder, seed, listener=steps(progress))

    def add(found: Iterable[RowTable]) -> None:
        tables.extend((table, table.write(folder)) for table in found)

    sweeps = {}
    for arrangement in chapter5.ARRANGEMENTS:
        with open_bench(arrangement.scene, LoadSweep.name) as session:
            swept = _swept(session, arrangement.design, arrangement.loads)
            assert session.model is not None  # of a scene
            ratio = ratio_by(session.model)
        traces = read_traces(session.record.folder, get_design(arrangement.design), FREQUENCY)
        sweeps[arrangement.design] = swept
        done.order_evidence[arrangement.design] = of_experiment(RATIO, ratio)
        done.orders[arrangement.design] = chapter5.order_is_right(swept, get_design(arrangement.design))
        add(chapter5.compare_experiment(arrangement, swept, traces, ratio))
    blind_sweeps = {}
    for parameters in chapter5.BLIND_SETS:
        for arrangement in chapter5.ARRANGEMENTS:
            with open_bench(arrangement.scene, LoadSweep.name, chapter5.BLIND_MODEL, parameters) as session:
                swept = _swept(session, arrangement.design, chapter5.loads_of(arrangement))
            blind_sweeps[arrangement.design, parameters] = swept
            table, distance = chapter5.compare_blind(arrangement, parameters, swept)
            done.blind.append(distance)
            add([table])
    with open_bench("thesis_single", LoadCellSeries.name) as session:
        weighed = conduct(LoadCellSeries(), _lab(session, "single"), session.record)
    add([chapter5.calibration_rows(weighed)])
    tested = {}
    for sample, number in COMPRESSION_TABLES.items():
        with open_bench("thesis_single", ModulusTest.name) as session:
            test = ModulusTest(sample, STRAIN, STEPS)
            tested[sample] = conduct(test, _lab(session, "single"), session.record)
        add([chapter5.compression_rows(number, sample, tested[sample])])
    add([chapter5.catalogue_rows(tested)])
    curves = models.run(models.SETS, done.models, progress)
    add(chapter5.percent_of_bench(found, sweeps) for found, _ in done.models.tables if found.table.number == "5.8")
    add([chapter5.percent_definitions()])
    measured = BenchMeasurements(sweeps, done.order_evidence, blind_sweeps, tested)
    done.models.pictures += [*bench_pictures(measured, models.SETS, curves, folder), draw_bridge(folder)]
    write_slips(folder)
    write_classes(done.verdicts(), folder)
    done.page = write_page(done, folder)


def _swept(session: Session, design: str, loads: tuple[float, ...]) -> SweepResult:
    """All samples under these loads."""
    sweep = LoadSweep(tuple(SAMPLES), loads, DWELL, FREQUENCY)
    return conduct(sweep, _lab(session, design), session.record)


def _lab(session: Session, design: str) -> Lab:
    """The bench with what the thesis says of sensor and load cell; a calibration of it is always of one date."""
    return Lab(session.bench, get_design(design), THESIS_LOAD_CELL, run=session.record.folder.name, started=CREATED)
