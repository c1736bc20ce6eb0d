"""A scene: which sensor, which model, which effects, which seed. Absent means absent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pydantic import Field

from palpate.instrument.config import Config, check, read
from palpate.instrument.contracts.sensor_node import place
from palpate.instrument.errors import ConfigError, RangeError, UnknownName, nearest
from palpate.instrument.models.foundation import springs
from palpate.instrument.models.parameter_sets import get_parameter_set
from palpate.instrument.models.response import AUTO, response
from palpate.instrument.models.table import MODELS, Response
from palpate.instrument.quantity import LARGEST_TOLERANCE, Metres, NewtonsPerAmpere, NewtonsPerMetre, Ohms
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.load import Load
from palpate.instrument.sensor.sample import SAMPLES, Sample
from palpate.simulators.effects import EFFECTS, effect_class
from palpate.simulators.effects.effect import Effect

if TYPE_CHECKING:
    from palpate.simulators.effects.triboelectric import Triboelectric
    from palpate.simulators.faults.fault import Fault

LARGEST_SEED = 2**63 - 1
MOST_EFFECTS = 100
WHEN, ON = "when", "on"  # a table's own key, and what it says if it has none
DITHER = "white_noise"  # makes the steps of a converter average out
EFFECTS_TOLERANCE = 1e-4  # of automatic effects, where the file has none


class RigParameters(Config):
    """Shaker and stack as a quasi-static stiffness chain.

    The armature hangs on its suspension and presses through the probe on sample and sensor. Suspension
    1 kN/m [A]: with the 3 kN/m of a stiffer shaker the softest sample would need 5.5 A peak for 4 N.
    """

    force_constant: NewtonsPerAmpere = Field(default=4.0, gt=0)  # [A]
    coil_resistance: Ohms = Field(default=3.5, gt=0)  # [A]
    suspension_stiffness: NewtonsPerMetre = Field(default=1000.0, gt=0)  # [A]
    sensor_position: Metres = Field(default=12e-3, gt=0)  # where the probe meets the bare sensor [A]


class SceneFile(Config):
    """The TOML file of a scene."""

    name: str
    purpose: str
    design: str
    model: str = "experiment"
    parameters: str | None = None  # set that goes over design and samples; None: they are as they are
    tolerance: float | None = Field(default=None, gt=0, le=LARGEST_TOLERANCE, strict=True)
    seed: int = Field(default=1, ge=0, le=LARGEST_SEED, strict=True)
    nodes: int | None = Field(default=None, ge=1, le=20, strict=True)  # None: as many as the films need
    rig: RigParameters = RigParameters()
    effects: dict[str, Any] = Field(default_factory=dict, max_length=MOST_EFFECTS)  # a table, "on" or "auto"
    fault: list[dict[str, Any]] | None = None  # see `simulators/faults/`


@dataclass(frozen=True)
class Scene:
    """A checked scene.

    Attributes:
        model: that answers; where the file says "auto", the one that was chosen for the samples.
        tolerance: to which it answers; None: its own.
        why: the model was chosen; empty where the file names it.
        effects: simulated, by name, in the order of the registry.
        called: why each effect is simulated.
        faults: what goes wrong, and when.
    """

    name: str
    purpose: str
    design: Design
    model: str
    tolerance: float | None
    why: str
    seed: int
    nodes: int
    rig: RigParameters
    effects: Mapping[str, Effect]
    called: Mapping[str, str]
    file: SceneFile
    faults: tuple[Fault, ...] = ()

    @property
    def pickup(self) -> float:
        """Bound on what cables add to a film's force, as a share of the load: what a bench file says of its bench."""
        cables = cast("Triboelectric | None", self.effects.get("triboelectric"))
        return cables.share if cables else 0.0

    def answer(self, sample: Sample) -> Response:
        """What the sensor does under 1 N through a sample, by the scene's model and parameter set.

        The stack that the shaker presses is as stiff as the sample is: a set's object is one for the model alone.

        Raises:
            RangeError: the model does not answer for this sensor and sample, or not to the tolerance.
            EstimateError: a linear system cannot be solved accurately.
        """
        found = response(self.design, _load(self.file, sample), self.model, self.tolerance)
        return replace(found, stiffness=springs.stiffness(self.design, sample))

    def to_toml(self) -> str:
        """The scene file that gives this scene: its seed, the model that answers, the effects that are in."""
        import tomli_w

        settled = {"seed": self.seed, "model": self.model, "tolerance": self.tolerance, "effects": self._effects_in()}
        file = self.file.model_copy(update=settled)
        return tomli_w.dumps(file.model_dump(mode="json", exclude_none=True))

    def _effects_in(self) -> dict[str, Any]:
        """As the file gives them, but on: what an automatic one was weighed against need not be the same again."""
        given = {name: self.file.effects[name] for name in self.effects}
        return {
            name: {key: value for key, value in of.items() if key != WHEN} if isinstance(of, dict) else ON
            for name, of in given.items()
        }

    def with_seed(self, seed: int) -> Scene:
        """The same scene with other noise and scatter. Raises RangeError."""
        if not 0 <= seed <= LARGEST_SEED:
            raise RangeError(f"seed {seed} is outside 0 to {LARGEST_SEED}; give one inside")
        return replace(self, seed=seed)

    def with_faults(self, given: Sequence[Mapping[str, Any]]) -> Scene:
        """The same scene with these faults after its own. Raises ConfigError."""
        from palpate.simulators.faults.fault import parse_faults

        every = [*(self.file.fault or ()), *map(dict, given)]
        faults = parse_faults(every, self.nodes, f"scene {self.name}")
        return replace(self, faults=faults, file=self.file.model_copy(update={"fault": every}))

    def with_model(self, model: str, parameters: str | None = None) -> Scene:
        """The same scene with another sensor model, to the file's tolerance where the model refines.

        Args:
            parameters: name of the set that goes over design and samples; None: the scene's own.

        Raises:
            UnknownName: no such model, or no such set of it. RangeError: no model meets the tolerance.
        """
        file = self.file.model_copy(update={"model": model, "parameters": parameters or self.file.parameters})
        if model in MODELS and MODELS[model].default_tolerance is None:
            file = file.model_copy(update={"tolerance": None})
        design = _design(file)
        name, tolerance, why = _chosen(design, file)
        return replace(self, design=design, model=name, tolerance=tolerance, why=why, file=file)


def shipped() -> dict[str, Path]:
    """The scenes that come with palpate, by name."""
    folder = Path(str(resources.files("palpate.simulators.scenes")))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def read_scene(name_or_file: str) -> Scene:
    """A shipped scene by name, or the scene in a file.

    Raises:
        UnknownName: neither a shipped scene nor a file.
        ConfigError: the file, an effect or a parameter is wrong; names file and key.
    """
    scenes = shipped()
    path = scenes.get(name_or_file, Path(name_or_file))
    if not name_or_file or (name_or_file not in scenes and path.suffix != ".toml" and not path.exists()):
        raise UnknownName("scene", name_or_file, scenes)
    return scene_of(read(path, SceneFile), path)


def scene_of(file: SceneFile, path: Path) -> Scene:
    """The scene that a file describes; `path` is what messages call it. Raises ConfigError as `read_scene`."""
    listed = _listed(file, path)
    try:
        design = _design(file)
        model, tolerance, why = _chosen(design, file)
    except (UnknownName, RangeError) as error:
        raise ConfigError(f"{path}: {error}") from None
    needed = max(place(film.channel)[0] for film in design.films)
    if file.nodes is not None and file.nodes < needed:
        raise ConfigError(
            f"{path}: nodes: {file.nodes} cannot take the {len(design.films)} films of design {design.name!r};"
            f" give {needed} or more, or leave it out"
        )
    effects, called = _called_for(listed, file, design, model)
    nodes = needed if file.nodes is None else file.nodes
    faults: tuple[Fault, ...] = ()
    if file.fault:
        from palpate.simulators.faults.fault import parse_faults

        faults = parse_faults(file.fault, nodes, str(path))
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
        faults=faults,
    )


def _listed(file: SceneFile, path: Path) -> dict[str, Effect]:
    """The effects that a file names, checked, in the order of the registry."""
    if unknown := [name for name in file.effects if name not in EFFECTS]:
        raise ConfigError(
            "\n".join(
                f"{path}: effects.{name}: unknown effect{nearest(name, EFFECTS)}; valid: {', '.join(EFFECTS)}"
                for name in unknown
            )
        )
    listed = {}
    for name in EFFECTS:
        if name in file.effects:
            given = file.effects[name]
            if _when(given) not in (ON, AUTO):
                key = f"effects.{name}.{WHEN}" if isinstance(given, dict) else f"effects.{name}"
                raise ConfigError(f"{path}: {key}: {_when(given)!r} is neither {ON!r} nor {AUTO!r}, nor a table")
            parameters = {k: v for k, v in given.items() if k != WHEN} if isinstance(given, dict) else {}
            listed[name] = check(parameters, effect_class(name), f"{path}: effects.{name}")
    for name, effect in listed.items():
        if others := [other for other in effect.excludes if other in listed]:
            raise ConfigError(f"{path}: effects.{name} and effects.{others[0]} exclude each other; leave one out")
    return listed


def _when(given: Any) -> Any:
    """Whether an effect is simulated: "on" or "auto"."""
    return given.get(WHEN, ON) if isinstance(given, dict) else given


def _called_for(
    listed: Mapping[str, Effect], file: SceneFile, design: Design, model: str
) -> tuple[dict[str, Effect], dict[str, str]]:
    """The effects that are simulated, and why: of the automatic ones those that can change more than the tolerance."""
    tolerance = EFFECTS_TOLERANCE if file.tolerance is None else file.tolerance
    called, beside = {}, dict(listed)
    for name in sorted(listed, key=DITHER.__ne__):  # first what the bounds of others count on
        if _when(file.effects[name]) == ON:
            called[name] = "called for"
            continue
        from palpate.simulators.planning.plan import needed

        others = {other: effect for other, effect in beside.items() if other != name}
        bound = needed(listed[name], design, file, model, others, tolerance)
        if bound is None:
            beside = others
        else:
            called[name] = f"can change force by {bound.force:.2g} and ratio by {bound.ratio:.2g}, above {tolerance:g}"
    return {name: effect for name, effect in listed.items() if name in called}, called


def _design(file: SceneFile) -> Design:
    """With what its parameter set replaces. Raises UnknownName: no such design, or no such set of the model."""
    design = get_design(file.design)
    return design if file.parameters is None else get_parameter_set(file.parameters, file.model).design(design)


def _load(file: SceneFile, sample: Sample) -> Load:
    """1 N through a sample, as the parameter set has its object: of the sample's modulus."""
    if file.parameters is None:
        return Load(force=1.0, sensed=sample)
    return get_parameter_set(file.parameters, file.model).load(sample.modulus)


def _chosen(design: Design, file: SceneFile) -> tuple[str, float | None, str]:
    """The model that answers, its tolerance, and why it was chosen: "auto" is settled once, for all samples."""
    if file.model == AUTO:
        from palpate.instrument.models.prices.price_list import AUTO_TOLERANCE, choose

        asked = AUTO_TOLERANCE if file.tolerance is None else file.tolerance
        choice = choose(design, [_load(file, sample) for sample in SAMPLES.values()], asked)
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
