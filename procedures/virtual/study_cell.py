"""Computes cells of a study, one by one or those of one scene as arrays, and has the executors that do it."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.drivers.bench import Bench
from palpate.instrument.additions import library
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.errors import ConfigError, RangeError, UnknownName
from palpate.instrument.findings.film_forces import film_forces, stacked_forces
from palpate.instrument.quantity import parse
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.instrument.signals.estimate import fit_sine, fit_sines
from palpate.procedures.console.terminal import say
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.about import packages_of
from palpate.procedures.lab.lab import Lab, Target, with_kinds
from palpate.procedures.measurements.loads import LoadSweep
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.record_file import as_json
from palpate.procedures.steps.checks import check_frequency
from palpate.procedures.steps.film_point import is_mostly_noise, is_short
from palpate.procedures.steps.flags import CLIPPED, SHORT, USED
from palpate.procedures.study.description import CLOSED_FORM, DEFAULTS, EFFECTS, Span, Study, Value
from palpate.procedures.study.run import FEW_CELLS, BlockBuilder, CellBlock, Column, attempt, reason_of
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.effects import effect_class
from palpate.simulators.planning.seeds import SeedArray, seed_bound
from palpate.simulators.planning.settle import read_scene, scene_of
from palpate.simulators.planning.waveforms import load_sets
from palpate.simulators.scenes.scene import Scene, SceneFile

Flags = npt.NDArray[np.bool_]

COLUMNS = (
    "load_N", "voltage_rigid_V", "voltage_total_V", "force_rigid_N", "force_total_N", "force_ratio", "force_ratio_u",
    "noise_u", "pickup_u", "degrees_of_freedom",
)  # fmt: skip
KEPT = 8  # scenes whose shared part a worker keeps
FEWEST = 4  # cells of a scene; for fewer the shared part, which takes as long as some of them, does not pay
SAMPLES = 300_000  # that are computed at once, so that they stay in the processor's cache
EPOCH = "2000-01-01T00:00:00+00:00"  # start time in records that are thrown away


@dataclass(frozen=True, slots=True)
class StudyComputation:
    """Computes the cells of a study; a worker process can receive it, because it holds all that the cells share.

    Attributes:
        scenes: the scene files, by name.
        how: "closed form" or "bench".
        loads: loads, peak to peak [N].
        frequency: frequency of the drive [Hz].
        dwell: dwell [s].
    """

    scenes: Mapping[str, SceneFile]
    how: str
    loads: tuple[float, ...]
    frequency: float
    dwell: float

    @classmethod
    def of(cls, study: Study, where: str) -> StudyComputation:
        """Read the scenes of a study; messages begin with `where`.

        Raises:
            ConfigError, UnknownName: a scene is wrong, or an effect or a parameter does not exist.
        """
        for name in study.axes:
            if name.startswith(EFFECTS):
                _check_parameter(name, where)
        named = study.axes.get("scene", [DEFAULTS["scene"]])
        assert not isinstance(named, Span)
        scenes = {str(name): read_scene(str(name)) for name in named}
        for scene in scenes.values():
            try:
                check_frequency(study.file.frequency, _target(scene))
            except RangeError as error:
                raise ConfigError(f"{where}: {error}") from None
        files = {name: scene.file for name, scene in scenes.items()}
        return cls(files, study.file.how, study.loads, study.file.frequency, study.file.dwell)

    def __call__(self, cell: Mapping[str, Value]) -> list[dict[str, Any]]:
        """The points of a cell, as rows by column name. Raises PalpateError: the cell cannot be computed."""
        scene, sample = self._checked(cell)
        ratio = scene.answer(sample).force_ratio
        points = self._closed_form(scene, sample) if self.how == CLOSED_FORM else self._on_a_bench(scene, sample)
        return [{**point, "model_force_ratio": ratio, "scene_seed": scene.seed} for point in points]

    def _checked(self, cell: Mapping[str, Value]) -> tuple[Scene, Sample]:
        """Scene and sample of a cell that can be measured."""
        scene, sample = self._scene(cell), _sample(cell)
        self._sweep(sample).check(_target(scene))
        return scene, sample

    def _sweep(self, sample: Sample) -> LoadSweep:
        return LoadSweep((sample.name,), self.loads, self.dwell, self.frequency)

    def block(self, study: Study, cells: range) -> CellBlock:
        """Outcomes of successive cells. Those that differ in their seeds alone are computed together, if possible."""
        builder = BlockBuilder(cells[0], len(cells), len(self.loads))
        values = [study.cell(cell) for cell in cells]
        alike: dict[str, list[int]] = {}
        for place, cell in enumerate(values):
            alike.setdefault(as_json(_but_seed(cell)), []).append(place)
        few = study.scenes() <= KEPT
        for places in alike.values():
            for place in self._together(builder, values, places, few):
                attempt(builder, place, partial(self, values[place]))
        return builder.block()

    def _together(
        self, builder: BlockBuilder, values: Sequence[Mapping[str, Value]], places: Sequence[int], few: bool
    ) -> Sequence[int]:
        """Compute cells that differ in their seeds alone as arrays; returns those that must be computed one by one.

        These are all of them on a bench, where an effect is not linear in what a seed draws, and where so few cells
        share a scene that this takes longer; else the few whose samples are not sure. Either way gives the same bytes.

        Args:
            builder: gets the outcomes.
            values: values of all cells of the block.
            places: the cells, by their places in the block.
            few: whether the study has so few scenes that a worker keeps all of them.
        """
        if self.how != CLOSED_FORM:
            return places
        try:
            scene, sample = self._checked(values[places[0]])
            if effect := seed_bound(scene):
                for place in places:
                    builder.alone(place, effect)
                return places
            if len(places) < FEWEST and not few:
                for place in places:
                    builder.alone(place, FEW_CELLS)
                return places
            seeds = [_own_seed(self._file(values[place]), values[place]) for place in places]
            array = _shared(_Asked(scene.with_seed(0), sample, self.loads, self.frequency, self.dwell))
            at_once = max(1, SAMPLES // array.samples_in)
            unsure: list[int] = []
            for first in range(0, len(places), at_once):
                some = np.array(places[first : first + at_once])
                columns, flags, sure = self._measured(scene, sample, array, seeds[first : first + at_once])
                builder.arrays(
                    some[sure].tolist(),
                    {name: column[sure] for name, column in columns.items()},
                    {name: raised[sure] for name, raised in flags.items()},
                )
                unsure += some[~sure].tolist()
            return unsure
        except Exception as error:  # it does not depend on the seed; a defect must not take other cells with it
            for place in places:
                builder.failed(place, reason_of(error))
            return []

    def _measured(
        self, scene: Scene, sample: Sample, array: SeedArray, seeds: Sequence[int]
    ) -> tuple[dict[str, Column], dict[str, Column], Flags]:
        """Points of cells under some seeds as columns (seeds, loads): values, flags, and which cells are sure."""
        samples = array.sampled(seeds)
        shape = samples.saturated.shape
        fit, fitted = fit_sines(array.seconds, samples.voltage.reshape(-1, *samples.voltage.shape[2:]), self.frequency)
        forces, answered = stacked_forces(scene.design.with_pickup(scene.pickup), fit)
        forces["degrees_of_freedom"] = np.where(np.isinf(fit.degrees_of_freedom), np.nan, fit.degrees_of_freedom)
        short = map(
            is_mostly_noise,
            *(forces[name].tolist() for name in ("force_ratio_u", "noise_u")),
            np.asarray(fit.degrees_of_freedom).tolist(),
        )
        columns = {
            "load_N": np.broadcast_to(np.array(self.loads), shape),
            **{name: forces[name].reshape(shape) for name in COLUMNS[1:]},
            "valid": ~samples.saturated,
            "model_force_ratio": np.full(shape, scene.answer(sample).force_ratio),
            "scene_seed": np.repeat(np.array(seeds)[:, np.newaxis], shape[1], axis=1),
        }
        flags = {CLIPPED: samples.saturated, SHORT: np.array([*short]).reshape(shape)}
        return columns, flags, samples.sure & (fitted & answered).reshape(shape).all(axis=1)

    def packages(self, study: Study) -> dict[str, str]:
        """Versions of the installed packages that devices, designs and effects of the study come from."""
        files = self.scenes.values()
        named = study.axes.get("design", [])
        assert not isinstance(named, Span)
        kinds = {str(table["kind"]) for file in files for table in (file.device or {}).values()}
        designs = {file.design for file in files} | set(map(str, named))
        varied = {name.split(".")[1] for name in study.axes if name.startswith(EFFECTS)}
        return packages_of(kinds, designs, varied.union(*(file.effects for file in files)))

    def _file(self, cell: Mapping[str, Value]) -> SceneFile:
        return self.scenes[str(cell["scene"])]

    def _scene(self, cell: Mapping[str, Value]) -> Scene:
        file = self._file(cell)
        changed: dict[str, Any] = {name: cell[name] for name in ("design", "model") if name in cell}
        changed["seed"] = _own_seed(file, cell)
        if "design" in cell:
            changed["nodes"] = None
        effects = dict(file.effects)
        for name, value in cell.items():
            if name.startswith(EFFECTS):
                _, effect, parameter = name.split(".")
                table = effects.get(effect, {})
                effects[effect] = {**(table if isinstance(table, dict) else {"when": table}), parameter: value}
        return scene_of(file.model_copy(update={**changed, "effects": effects}), Path(str(cell["scene"])))

    def _closed_form(self, scene: Scene, sample: Sample) -> Iterator[dict[str, Any]]:
        design = scene.design.with_pickup(scene.pickup)
        for point in load_sets(scene, sample, self.loads, self.frequency, self.dwell):
            fit = fit_sine(point.time, point.voltage, self.frequency)
            forces = film_forces(design, fit)
            flags = tuple(f for f, on in ((CLIPPED, point.saturated.any()), (SHORT, is_short(design, fit))) if on)
            yield _point({"load_N": point.load, **asdict(forces)}, flags)

    def _on_a_bench(self, scene: Scene, sample: Sample) -> Iterator[dict[str, Any]]:
        """Measure a cell on a simulated bench like `palpate sweep loads`; the record is thrown away."""
        header = {"procedure": "study", "simulated": True, "started": EPOCH}
        with (
            tempfile.TemporaryDirectory(prefix="palpate-") as folder,
            SimulatedBench(scene, stepped=True) as simulated,
            Recorder.create(Path(folder), header) as record,
            Bench(simulated.description, simulated.clock, simulated.operator) as bench,
        ):
            design = scene.design.with_pickup(scene.pickup)
            swept = conduct(self._sweep(sample), Lab(bench, design, THESIS_LOAD_CELL), record)
            record.finish("complete", {})
        return (_point(asdict(point), point.flags) for point in swept.points)


def _target(scene: Scene) -> Target:
    force_limit = BenchDescription.model_fields["force_limit"].default
    return with_kinds(Target(scene.design, force_limit, scene.nodes), scene.kind_in)


@dataclass(frozen=True, slots=True)
class _Asked:
    """What cells that are computed together share. Scenes of one name and identity are alike but for their seeds."""

    scene: Scene = field(compare=False)
    sample: Sample
    loads: tuple[float, ...]
    frequency: float
    dwell: float
    of_scene: tuple[str, str] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "of_scene", (self.scene.name, self.scene.identity))


@lru_cache(KEPT)
def _shared(asked: _Asked) -> SeedArray:
    """The part that cells share; blocks of one scene follow each other."""
    return SeedArray(asked.scene, asked.sample, asked.loads, asked.frequency, asked.dwell)


def _but_seed(cell: Mapping[str, Value]) -> dict[str, Value]:
    return {name: value for name, value in cell.items() if name != "seed"}


def _own_seed(file: SceneFile, cell: Mapping[str, Value]) -> int:
    """Seed of a cell's scene, from all values of the cell: cells with the same seed must not have the same noise."""
    content = as_json((int(cell.get("seed", file.seed)), _but_seed(cell)))
    return int.from_bytes(hashlib.sha256(content.encode()).digest()[:6])  # 48 bits are exact in a float


def _point(values: Mapping[str, Any], flags: Sequence[str]) -> dict[str, Any]:
    return {**{name: values[name] for name in COLUMNS}, "valid": USED.issuperset(flags), "flags": list(flags)}


def _sample(cell: Mapping[str, Value]) -> Sample:
    sample = get_sample(str(cell["sample"]))
    return replace(sample, modulus=parse(str(cell["modulus"]), "Pa")) if "modulus" in cell else sample


def _check_parameter(name: str, where: str) -> None:
    """Check that `effects.NAME.PARAMETER` exists. Raises ConfigError."""
    _, effect, *parameter = name.split(".")
    try:
        parameters = effect_class(effect).model_fields
        if len(parameter) != 1 or parameter[0] not in parameters:
            raise UnknownName(f"parameter of the effect {effect}", ".".join(parameter), parameters)
    except UnknownName as error:
        raise ConfigError(f"{where}: axes.{name}: {error}") from None


# --- Executors that compute the cells of a study: processes on this machine, or a dask cluster ---------


@contextmanager
def executor_of(workers: int | None, dask: str | None) -> Iterator[tuple[Executor, int]]:
    """An executor, and the number of its workers.

    Args:
        workers: number of processes; None: one for each core. Where there can be none, a thread computes the cells.
        dask: address of a dask scheduler to use instead of processes; None: processes.

    Raises:
        UsageError: dask.distributed is not installed.
        OSError: no scheduler answers.
    """
    if dask is not None:
        with library("distributed", "dask").Client(dask) as client:
            yield client.get_executor(), max(1, sum(client.ncores().values()))
        return
    os.environ["OMP_NUM_THREADS"] = "1"  # one core for each worker, and a fixed order of summation
    count = len(os.sched_getaffinity(0)) if workers is None else workers
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["palpate.procedures.virtual.study_cell"])  # imported once for all workers
    executor: Executor
    try:
        executor = ProcessPoolExecutor(count, context, _begin_worker)
    except (OSError, ImportError, NotImplementedError) as error:  # without semaphores
        say(
            f"palpate: note: cells are computed one by one, because processes cannot work together here ({error}); "
            "make /dev/shm writable: mount -t tmpfs tmpfs /dev/shm",
            err=True,
        )
        executor, count = ThreadPoolExecutor(1), 1
    with executor:
        yield executor, count


def _begin_worker() -> None:
    """Ignore Ctrl-C, which the parent process handles; and end with the parent, which may be killed without notice."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
