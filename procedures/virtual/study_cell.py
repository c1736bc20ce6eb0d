"""Computes one cell of a study, in closed form or on a simulated bench."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from palpate.drivers.bench import Bench
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.calibration.load_cell_fit import THESIS_LOAD_CELL
from palpate.instrument.errors import ConfigError, RangeError, UnknownName
from palpate.instrument.findings.film_forces import film_forces
from palpate.instrument.quantity import parse
from palpate.instrument.sensor.sample import Sample, get_sample
from palpate.instrument.signals.estimate import fit_sine
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.lab import Lab, Target, with_kinds
from palpate.procedures.lab.software import packages_of
from palpate.procedures.measurements.loads.procedure import LoadSweep
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.record_file import as_json
from palpate.procedures.steps.checks import check_frequency
from palpate.procedures.steps.film_point import is_short
from palpate.procedures.steps.flags import CLIPPED, SHORT, USED
from palpate.procedures.study.description import CLOSED_FORM, DEFAULTS, EFFECTS, Span, Study, Value
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.effects import effect_class
from palpate.simulators.planning.settle import read_scene, scene_of
from palpate.simulators.planning.waveforms import load_sets
from palpate.simulators.scenes.scene import Scene, SceneFile

COLUMNS = (
    "load_N", "voltage_rigid_V", "voltage_total_V", "force_rigid_N", "force_total_N", "force_ratio", "force_ratio_u",
    "noise_u", "pickup_u", "degrees_of_freedom",
)  # fmt: skip
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
        scene, sample = self._scene(cell), _sample(cell)
        sweep = LoadSweep((sample.name,), self.loads, self.dwell, self.frequency)
        sweep.check(_target(scene))
        ratio = scene.answer(sample).force_ratio
        points = self._closed_form(scene, sample) if self.how == CLOSED_FORM else _on_a_bench(scene, sweep)
        return [{**point, "model_force_ratio": ratio, "scene_seed": scene.seed} for point in points]

    def packages(self, study: Study) -> dict[str, str]:
        """Versions of the installed packages that devices, designs and effects of the study come from."""
        files = self.scenes.values()
        named = study.axes.get("design", [])
        assert not isinstance(named, Span)
        kinds = {str(table["kind"]) for file in files for table in (file.device or {}).values()}
        designs = {file.design for file in files} | set(map(str, named))
        varied = {name.split(".")[1] for name in study.axes if name.startswith(EFFECTS)}
        return packages_of(kinds, designs, varied.union(*(file.effects for file in files)))

    def _scene(self, cell: Mapping[str, Value]) -> Scene:
        file = self.scenes[str(cell["scene"])]
        changed: dict[str, Any] = {name: cell[name] for name in ("design", "model") if name in cell}
        changed["seed"] = _own_seed(int(cell.get("seed", file.seed)), cell)
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


def _target(scene: Scene) -> Target:
    force_limit = BenchDescription.model_fields["force_limit"].default
    return with_kinds(Target(scene.design, force_limit, scene.nodes), scene.kind_in)


def _own_seed(seed: int, cell: Mapping[str, Value]) -> int:
    """Seed of a cell's scene, from all values of the cell: cells with the same seed must not have the same noise."""
    varied = {name: value for name, value in cell.items() if name != "seed"}
    return int.from_bytes(hashlib.sha256(as_json((seed, varied)).encode()).digest()[:6])  # 48 bits are exact in a float


def _on_a_bench(scene: Scene, sweep: LoadSweep) -> Iterator[dict[str, Any]]:
    """Measure a cell on a simulated bench like `palpate sweep loads`; the record is thrown away."""
    header = {"procedure": "study", "simulated": True, "started": EPOCH}
    with (
        tempfile.TemporaryDirectory(prefix="palpate-") as folder,
        SimulatedBench(scene, stepped=True) as simulated,
        Recorder.create(Path(folder), header) as record,
        Bench(simulated.description, simulated.clock, simulated.operator) as bench,
    ):
        design = scene.design.with_pickup(scene.pickup)
        swept = conduct(sweep, Lab(bench, design, THESIS_LOAD_CELL), record)
        record.finish("complete", {})
    return (_point(asdict(point), point.flags) for point in swept.points)


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
