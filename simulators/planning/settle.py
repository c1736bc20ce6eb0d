"""Makes a scene from its file: chooses the sensor model and the simulated effects, and reads the faults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.instrument.bench.description import placed
from palpate.instrument.config import check, read_data
from palpate.instrument.errors import ConfigError, RangeError, UnknownName, nearest
from palpate.instrument.models.parameters import get_parameter_set
from palpate.instrument.models.response import AUTO
from palpate.instrument.models.table import MODELS
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.effects import EFFECTS, effect_class, effect_names, in_order, origin
from palpate.simulators.guests import Guest, guests
from palpate.simulators.physics.effect import Bound, Effect, rival
from palpate.simulators.scenes.heads import fewest_nodes, shipped
from palpate.simulators.scenes.scene import ON, WHEN, Scene, SceneFile, load_of

if TYPE_CHECKING:
    from palpate.simulators.faults.fault import Fault

EFFECTS_TOLERANCE = 1e-4  # tolerance of automatic effects if the file has none
THESIS_LOADS = (1.5, 4.0)  # N; the least and the greatest load of Tables A2.9 to A2.14


def read_scene(name_or_file: str) -> Scene:
    """Read a shipped scene by its name, or the scene in a file.

    Raises:
        UnknownName: it is neither a shipped scene nor a file.
        ConfigError: the file, an effect or a parameter is wrong; the message names file and key.
    """
    scenes = shipped()
    path = scenes.get(name_or_file, Path(name_or_file))
    if not name_or_file or (name_or_file not in scenes and path.suffix != ".toml" and not path.exists()):
        raise UnknownName("scene", name_or_file, scenes)
    return scene_of(check(placed(path, read_data(path)), SceneFile, str(path)), path)


def scene_of(file: SceneFile, path: Path) -> Scene:
    """The scene that a file describes; `path` names it in messages. Raises ConfigError as `read_scene` does."""
    listed = _listed(file, path)
    try:
        design = _design(file)
        model, tolerance, why = _chosen(design, file)
    except (UnknownName, RangeError) as error:
        raise ConfigError(f"{path}: {error}") from None
    needed = fewest_nodes(design)
    if file.nodes is not None and file.nodes < needed:
        raise ConfigError(
            f"{path}: nodes: {file.nodes} cannot take the {len(design.films)} films of design {design.name!r};"
            f" give {needed} or more, or leave it out"
        )
    effects, called = _called_for(listed, file, design, model)
    nodes = needed if file.nodes is None else file.nodes
    devices = guests(file.device or {}, str(path))
    return Scene(
        name=file.name,
        purpose=file.purpose,
        design=design,
        model=model,
        tolerance=tolerance,
        why=why,
        seed=file.seed,
        nodes=nodes,
        rig=file.rig,
        effects=effects,
        called=called,
        file=file,
        faults=_faults(file.fault, nodes, devices, str(path)),
        devices=devices,
    )


def with_model(scene: Scene, model: str, parameters: str | None = None) -> Scene:
    """The same scene with another sensor model, to the file's tolerance where the model refines.

    Args:
        scene: the scene.
        model: name of the model.
        parameters: name of the set that overrides design and samples; None: the scene's own.

    Raises:
        UnknownName: there is no such model, or it has no such set.
        RangeError: no model meets the tolerance.
    """
    file = scene.file.model_copy(update={"model": model, "parameters": parameters or scene.file.parameters})
    if model in MODELS and MODELS[model].default_tolerance is None:
        file = file.model_copy(update={"tolerance": None})
    design = _design(file)
    name, tolerance, why = _chosen(design, file)
    return replace(scene, design=design, model=name, tolerance=tolerance, why=why, file=file)


def with_faults(scene: Scene, given: Sequence[Mapping[str, Any]]) -> Scene:
    """The same scene with these faults after its own. Raises ConfigError."""
    every = [*(scene.file.fault or ()), *map(dict, given)]
    faults = _faults(every, scene.nodes, scene.devices, f"scene {scene.name}")
    return replace(scene, faults=faults, file=scene.file.model_copy(update={"fault": every}))


def _faults(
    given: Sequence[Mapping[str, Any]] | None, nodes: int, devices: Sequence[Guest], where: str
) -> tuple[Fault, ...]:
    """Read and check faults; without any, nothing is imported. Raises ConfigError as `parse_faults` does."""
    if not given:
        return ()
    from palpate.simulators.faults.fault import parse_faults, places

    return parse_faults(given, places(nodes, devices), where)


def _listed(file: SceneFile, path: Path) -> dict[str, Effect]:
    """The effects that a file names, checked, in the order of the chain."""
    if outside := [name for name in file.effects if name not in EFFECTS]:
        names = effect_names()
        if unknown := [name for name in outside if name not in names]:
            raise ConfigError(
                "\n".join(
                    f"{path}: effects.{name}: unknown effect{nearest(name, names)}; valid: {', '.join(names)}"
                    for name in unknown
                )
            )
    listed = {}
    for name, given in in_order(file.effects).items():
        if _when(given) not in (ON, AUTO):
            key = f"effects.{name}.{WHEN}" if isinstance(given, dict) else f"effects.{name}"
            raise ConfigError(f"{path}: {key}: {_when(given)!r} is neither {ON!r} nor {AUTO!r}, nor a table")
        parameters = {k: v for k, v in given.items() if k != WHEN} if isinstance(given, dict) else {}
        listed[name] = check(parameters, effect_class(name), f"{path}: effects.{name}")
    for name, effect in listed.items():
        if other := rival(effect, listed):
            raise ConfigError(f"{path}: effects.{name} and effects.{other} exclude each other; leave one out")
    return listed


def _when(given: Any) -> Any:
    """Whether an effect is simulated: "on" or "auto"."""
    return given.get(WHEN, ON) if isinstance(given, dict) else given


def _called_for(
    listed: Mapping[str, Effect], file: SceneFile, design: Design, model: str
) -> tuple[dict[str, Effect], dict[str, str]]:
    """Simulated effects with reasons; of the automatic ones, those that can change more than the tolerance."""
    tolerance = EFFECTS_TOLERANCE if file.tolerance is None else file.tolerance
    called, beside = {}, dict(listed)
    for name in sorted(listed, key=lambda name: not listed[name].dither(1.0)):  # effects that dither come first
        if _when(file.effects[name]) == ON:
            called[name] = "called for"
            continue
        others = {other: effect for other, effect in beside.items() if other != name}
        bound = _largest(listed[name], design, file, model, others)
        if max(bound.force, bound.ratio) > tolerance:
            called[name] = f"can change force by {bound.force:.2g} and ratio by {bound.ratio:.2g}, above {tolerance:g}"
        else:
            beside = others
    called = {name: why + origin(name) for name, why in called.items()}
    return {name: effect for name, effect in listed.items() if name in called}, called


def _largest(effect: Effect, design: Design, file: SceneFile, model: str, others: Mapping[str, Effect]) -> Bound:
    """The largest bound of an effect beside others, for the thesis' samples and loads."""
    from palpate.simulators.bounds import bound_of
    from palpate.simulators.planning.plan import Question, case_of

    bounds = [
        bound_of(case_of(design, model, others, Question(sample, load), file.rig, file.parameters), effect)
        for sample in SAMPLES
        for load in THESIS_LOADS
    ]
    return Bound(max(bound.force for bound in bounds), max(bound.ratio for bound in bounds))


def _design(file: SceneFile) -> Design:
    """The design with its parameter set. Raises UnknownName: there is no such design, or no such set of the model."""
    design = get_design(file.design)
    return design if file.parameters is None else get_parameter_set(file.parameters, file.model).design(design)


def _chosen(design: Design, file: SceneFile) -> tuple[str, float | None, str]:
    """The model that answers, its tolerance, and the reason; "auto" is chosen once for all samples."""
    if file.model == AUTO:
        from palpate.instrument.models.price_list import AUTO_TOLERANCE, choose

        asked = AUTO_TOLERANCE if file.tolerance is None else file.tolerance
        choice = choose(design, [load_of(file, sample) for sample in SAMPLES.values()], asked)
        refines = MODELS[choice.model].default_tolerance is not None
        return choice.model, asked if refines else None, choice.why
    if file.model not in MODELS:
        raise UnknownName("model", file.model, (*MODELS, AUTO))
    automatic = any(_when(given) == AUTO for given in file.effects.values())
    if file.tolerance is not None and MODELS[file.model].default_tolerance is None and not automatic:
        raise RangeError(
            f"tolerance: model {file.model!r} has no error estimate to meet {file.tolerance:g}; leave it out,"
            f" or take model {AUTO!r}"
        )
    return file.model, file.tolerance if MODELS[file.model].default_tolerance is not None else None, ""
