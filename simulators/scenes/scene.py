"""A scene: sensor design, sensor model, effects, faults and seed of a simulated bench."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

from pydantic import Field, model_validator

from palpate.instrument.bench.description import LoadChannel
from palpate.instrument.bench.kinds import DeviceKind, Role
from palpate.instrument.config import Config
from palpate.instrument.errors import RangeError
from palpate.instrument.models import springs
from palpate.instrument.models.parameters import get_parameter_set
from palpate.instrument.models.response import response
from palpate.instrument.models.table import Response
from palpate.instrument.quantity import LARGEST_TOLERANCE, Metres, NewtonsPerAmpere, NewtonsPerMetre, Ohms
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Load, Sample
from palpate.simulators.guests import Guest, guests, kind_in
from palpate.simulators.numbers import Numbers
from palpate.simulators.physics.effect import Effect

if TYPE_CHECKING:
    from palpate.simulators.faults.fault import Fault

USUAL_DRIVE = 10.0  # Hz
LARGEST_SEED = 2**63 - 1
MOST_EFFECTS = 100
IDENTITY = 16  # hexadecimal digits of what tells scenes apart
WHEN, ON = "when", "on"  # key of an effect's table that says when it is simulated, and its value if it is absent


class RigParameters(Numbers):
    """Parameters of the shaker and of the sensor's place, as a chain of springs without mass.

    The armature hangs on its suspension and presses through the probe on sample and sensor. The suspension is assumed
    to have 1 kN/m [A]: with the 3 kN/m of a stiffer shaker the softest sample would need a peak of 5.5 A for 4 N.
    """

    force_constant: NewtonsPerAmpere = Field(default=4.0, ge=1e-3, le=1e4)  # [A]
    coil_resistance: Ohms = Field(default=3.5, ge=1e-3, le=1e6)  # [A]
    suspension_stiffness: NewtonsPerMetre = Field(default=1000.0, ge=1, le=1e9)  # [A]
    # position at which the probe meets the bare sensor [A]
    sensor_position: Metres = Field(default=12e-3, ge=1e-6, le=1)


class SceneFile(Config):
    """The keys of a scene file (TOML)."""

    file: ClassVar[str] = "scene"

    name: str
    purpose: str
    design: str
    model: str = "experiment"
    parameters: str | None = None  # parameter set that replaces values of design and samples; None: no set
    tolerance: float | None = Field(default=None, gt=0, le=LARGEST_TOLERANCE, strict=True)
    seed: int = Field(default=1, ge=0, le=LARGEST_SEED, strict=True)
    nodes: int | None = Field(default=None, ge=1, le=20, strict=True)  # sensor nodes; None: as many as the films need
    load_channel: LoadChannel | None = None  # as in a bench file
    rig: RigParameters = RigParameters()
    effects: dict[str, Any] = Field(default_factory=dict, max_length=MOST_EFFECTS)  # a table, "on" or "auto"
    device: dict[str, dict[str, Any]] | None = None  # additional devices, see `simulators/guests.py`
    beside: dict[str, dict[str, Any]] | None = None  # read beside each point, see `instrument/bench/description.py`
    fault: list[dict[str, Any]] | None = None  # see `simulators/faults/`
    fidelity: float | None = Field(default=None, gt=0, lt=1, strict=True)  # by which effects were left out of this file
    left_out: tuple[str, ...] | None = None  # these effects; palpate writes both keys into the scenes of its runs

    @model_validator(mode="after")
    def _reduced(self) -> Self:
        """Check that both keys stand together, as palpate writes them."""
        if (self.fidelity is None) != (self.left_out is None):
            raise ValueError("fidelity and left_out tell what palpate left out; give --fidelity to a command instead")
        return self


@dataclass(frozen=True)
class Scene:
    """A checked scene.

    Attributes:
        name: its name.
        purpose: what it is for, in a sentence.
        design: the sensor design.
        model: name of the sensor model; if the file says "auto", of the model that was chosen for the samples.
        tolerance: relative tolerance to which the model answers; None: the model's own.
        why: why the model was chosen; empty if the file names it.
        seed: seed of all noise and scatter.
        nodes: number of sensor nodes.
        rig: parameters of the shaker.
        effects: the simulated effects by name, in the order of the registry.
        called: the reason why each effect is simulated, by name.
        file: the scene file as it was read.
        faults: faults that the scene injects.
        devices: devices in addition to the usual ones.
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
    devices: tuple[Guest, ...] = ()

    @cached_property
    def identity(self) -> str:
        """What tells its devices from those of other scenes, for calibrations: a hash of all but name and purpose.

        The seed counts, since by it the scatter of the films, offsets and phases are drawn. A parameter counts by its
        value, in whatever unit the file has it, and the same whether the file states it or leaves it at its default.
        """
        devices = [
            (
                each.name,
                each.table.get("role"),
                each.kind.contract.digest(),
                each.settings.model_dump(mode="json"),
            )
            for each in self.devices
        ]
        correlations = sorted((*films, value) for films, value in self.design.scatter_correlation.items())
        content = {
            "design": {**asdict(self.design), "scatter_correlation": correlations},
            "model": (self.model, self.tolerance, self.file.parameters),
            "seed": self.seed,
            "nodes": self.nodes,
            "rig": self.rig.model_dump(mode="json"),
            "effects": {name: effect.model_dump(mode="json") for name, effect in self.effects.items()},
            "devices": devices,
            "faults": self.file.fault,
        }
        written = json.dumps(content, sort_keys=True, default=dict)
        return hashlib.sha256(written.encode()).hexdigest()[:IDENTITY]

    @property
    def pickup(self) -> float:
        """Bound on the force that pickup in the cables adds to a film, as a share of the load; for the bench file."""
        return math.fsum(effect.pickup for effect in self.effects.values())

    @property
    def noise(self) -> float:
        """Amplitude density of the films' noise near the usual drive [V/√Hz], for the bench file; 0: there is none.

        The steps of the converter are not in it.
        """
        return math.hypot(*(effect.noise_density(USUAL_DRIVE) for effect in self.effects.values()))

    def kind_in(self, role: Role) -> DeviceKind | None:
        """Kind of the device that fills a role on the simulated bench; None: there is none."""
        return kind_in(role, self.devices)

    def answer(self, sample: Sample) -> Response:
        """Response of the sensor to 1 N through a sample, by the scene's model and parameter set.

        The stiffness comes from the real sample, because a parameter set changes the object of the model only.

        Raises:
            RangeError: the model does not hold for this sensor and sample, or cannot meet the tolerance.
            EstimateError: a linear system cannot be solved accurately.
        """
        found = response(self.design, load_of(self.file, sample), self.model, self.tolerance)
        return replace(found, stiffness=springs.stiffness(self.design, sample))

    def to_toml(self) -> str:
        """A scene file for exactly this scene: with its seed, the chosen model, and each simulated effect on."""
        import tomli_w

        settled = {"seed": self.seed, "model": self.model, "tolerance": self.tolerance, "effects": self._effects_in()}
        file = self.file.model_copy(update=settled)
        return tomli_w.dumps(file.model_dump(mode="json", exclude_none=True))

    def _effects_in(self) -> dict[str, Any]:
        """The file's tables of the simulated effects, all on, because an automatic choice could change."""
        given = {name: self.file.effects[name] for name in self.effects}
        return {
            name: {key: value for key, value in of.items() if key != WHEN} if isinstance(of, dict) else ON
            for name, of in given.items()
        }

    def with_devices(self, tables: Mapping[str, Mapping[str, Any]]) -> Scene:
        """The same scene with these additional devices instead of its own. Raises ConfigError."""
        given = {name: dict(table) for name, table in tables.items()}
        file = self.file.model_copy(update={"device": given or None})
        return replace(self, devices=guests(given, f"scene {self.name}"), file=file)

    def at_fidelity(self, fidelity: float, left_out: Sequence[str]) -> Scene:
        """The same scene, whose file tells by which fidelity which effects were left out of it."""
        return replace(self, file=self.file.model_copy(update={"fidelity": fidelity, "left_out": tuple(left_out)}))

    def with_seed(self, seed: int) -> Scene:
        """The same scene with another seed, so with other noise and scatter. Raises RangeError."""
        if not (isinstance(seed, int) and 0 <= seed <= LARGEST_SEED):
            raise RangeError(f"seed {seed!r} is no whole number from 0 to {LARGEST_SEED}; give one inside")
        return replace(self, seed=seed)


def load_of(file: SceneFile, sample: Sample) -> Load:
    """A load of 1 N through a sample; a parameter set takes its own object, with the sample's modulus."""
    if file.parameters is None:
        return Load(force=1.0, sensed=sample)
    return get_parameter_set(file.parameters, file.model).load(sample.modulus)
