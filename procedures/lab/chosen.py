"""Which bench a command or script is for: that of a bench file, of a scene, or of a logged run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from palpate.instrument.bench.description import BenchDescription, read_bench
from palpate.instrument.bench.kinds import KINDS, Role
from palpate.instrument.bench.operator import Operator
from palpate.instrument.contracts.own import CHANNELS
from palpate.instrument.errors import UsageError
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.lab.about import packages_of
from palpate.procedures.lab.lab import Dwells, Target, with_kinds
from palpate.procedures.lab.logged import LoggedRun
from palpate.procedures.lab.operator import ASSUME, Mounting, check_somebody
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene, with_model
from palpate.simulators.planning.weights import reduced
from palpate.simulators.scenes.scene import Scene

DEFAULT_SCENE = "thesis_single"


@dataclass(frozen=True, slots=True)
class Chosen:
    """Which bench to open: that of a bench file, the simulated bench of a scene, or that of a logged run.

    Attributes:
        description: content of the bench file; None: the bench is simulated.
        scene: the scene; None: the bench is real.
        assume_mounted: True: nobody is asked to confirm what was mounted or placed by hand.
        operator: does the work by hand; None: the person at the console.
        logged: the logged run to replay; None: the bench answers itself.
        about: what each run says about itself, by the lab's keys.
        pace: most simulated seconds in a second of the wall's clock; None: no limit.
    """

    description: BenchDescription | None
    scene: Scene | None
    assume_mounted: bool = False
    operator: Operator | None = None
    logged: LoggedRun | None = None
    about: Mapping[str, str] = field(default_factory=dict)
    pace: float | None = None

    @classmethod
    def of_log(cls, logged: LoggedRun) -> Chosen:
        """The bench whose answers a log holds."""
        return cls(logged.wire.description, logged.scene, logged=logged, about=logged.run.about)

    @property
    def target(self) -> Target:
        """What is known of the bench before it is opened. Raises ConfigError, UnknownName."""
        if self.description is not None:
            stated = self.description
            design = get_design(stated.design).with_pickup(stated.pickup).with_noise(stated.noise)
            nodes = self.description.filling("sensor_node")
            channels = nodes[0].kind.channels if nodes else CHANNELS
            target = Target(
                design,
                stated.force_limit,
                len(nodes),
                channels=channels,
                drivable=self._check_described,
                scene=stated.scene,
            )
            return with_kinds(target, self.description.kind_in)
        assert self.scene is not None
        design = self.scene.design.with_pickup(self.scene.pickup).with_noise(self.scene.noise)
        force_limit = BenchDescription.model_fields["force_limit"].default
        given = [guest.kind for guest in self.scene.devices if guest.table.get("role") == "sensor_node"]
        count, channels = (len(given), given[0].channels) if given else (self.scene.nodes, CHANNELS)
        target = Target(
            design,
            force_limit,
            count,
            self.scene.model,
            channels,
            drivable=self._check_guests,
            scene=self.scene.identity,
        )
        return with_kinds(target, self.scene.kind_in)

    def _check_described(self, frequency: float) -> None:
        """Check by the bench file alone that the bench can have a load of a frequency [Hz]. Raises as it does."""
        from palpate.drivers.bench import check_drivable  # with the libraries of the buses

        assert self.description is not None
        check_drivable(self.description, frequency)

    def _check_guests(self, frequency: float) -> None:
        """Check by the scene alone that its additional devices can work with a load of a frequency [Hz].

        One that fills no role, as a node that only sends SYNC, measures and drives nothing. Raises RangeError,
        ConfigError: a device cannot, or its section lacks a key.
        """
        assert self.scene is not None
        for guest in self.scene.devices:
            if guest.table.get("role") or "exciter" in guest.kind.roles:
                from palpate.drivers.bench import check_alone

                check_alone(guest.name, guest.kind, guest.settings, frequency)

    def check_names(self) -> None:
        """Raises ConfigError: a device, the design or an effect has a name that an installed package uses as well."""
        if self.description is not None:
            packages_of({each.kind.name for each in self.description.devices}, {self.description.design}, ())
        elif self.scene is not None:
            kinds = {*KINDS, *(guest.kind.name for guest in self.scene.devices)}
            packages_of(kinds, {self.scene.design.name}, self.scene.effects)

    def check_beside(self) -> None:
        """Raises ConfigError: the simulated bench cannot read or sample what its scene asks for beside each point."""
        if self.scene is not None and (self.scene.file.beside or self.scene.file.load_channel):
            from palpate.simulators.bench import SimulatedBench

            SimulatedBench(self.scene).check_beside()

    def mounting(
        self, manual_work: str, automated_by: Role | None = None, fills: Callable[[Role], object] | None = None
    ) -> Mounting:
        """How a run will know what is mounted. Raises UsageError as `check_somebody` does.

        Args:
            manual_work: what a person does in addition to mounting samples, as "places the weights"; empty: nothing.
            automated_by: role of a device that does this work instead, if the bench has one; None: no device can.
            fills: whether a device fills a role; None: whether the bench file lists one.
        """
        if self.logged is not None:
            return self.logged.mounting
        if self.description is None:
            return "simulated"
        if self.operator is not None:
            return "confirmed"
        fills = fills or self.description.filling
        if automated_by is not None and fills(automated_by):
            manual_work = ""
        return check_somebody(manual_work, bool(fills("sample_changer")), self.assume_mounted)


def choose(
    bench: Path | None,
    scene: str | None = None,
    seed: int | None = None,
    model: str | None = None,
    parameters: str | None = None,
    assume_mounted: bool = False,
    operator: Operator | None = None,
    about: Mapping[str, str] | None = None,
) -> Chosen:
    """The bench of a bench file or, if none is named, the simulated bench of a scene.

    Raises:
        UsageError: the options exclude each other.
        ConfigError, UnknownName: the bench file or the scene is wrong.
    """
    if bench is None:
        if assume_mounted:
            raise UsageError(f"{ASSUME}: a simulated bench mounts its samples itself; leave it out or give --bench")
        return Chosen(None, _scene(scene, seed, model, parameters), about=about or {})
    given = {"--scene": scene, "--seed": seed, "--model": model}
    if extra := [option for option, value in given.items() if value is not None]:
        raise UsageError(f"{', '.join(extra)}: only for a simulated bench; leave this out, or leave out --bench")
    return Chosen(read_bench(bench), None, assume_mounted, operator, about=about or {})


def _scene(name: str | None, seed: int | None, model: str | None, parameters: str | None) -> Scene:
    scene = read_scene(DEFAULT_SCENE if name is None else name)
    if seed is not None:
        scene = scene.with_seed(seed)
    return with_model(scene, model, parameters) if model is not None else scene


# --- Leaves out of a simulated bench the effects that the result of a procedure does not feel ----------

FIDELITY = "--fidelity"


def at_fidelity(chosen: Chosen, fidelity: float, procedure: str, dwells: Dwells | None, seconds: float) -> Chosen:
    """The simulated bench without the effects that change no load set of a procedure by more than a fidelity.

    Args:
        chosen: the bench.
        fidelity: greatest relative change of force and force ratio.
        procedure: name of the procedure.
        dwells: its load sets; None: its result comes from more than these.
        seconds: expected time on the bench, after which the first one is tried, too [s].

    Raises:
        UsageError: the bench is real, or the procedure has no load sets alone.
        RangeError: the scene's model does not answer for an object.
        EstimateError: the films of the scene give no force ratio.
    """
    if chosen.scene is None:
        raise UsageError(f"{FIDELITY}: a real bench leaves nothing out; leave out this option")
    if dwells is None:
        raise UsageError(
            f"{FIDELITY}: the result of procedure {procedure!r} comes from more than load sets of one frequency, so it "
            "is not known what it feels; leave out this option"
        )
    loads = dict.fromkeys(dwells.loads)  # the least one first
    questions = [Question(each, load, dwells.frequency, dwells.dwell) for each in dwells.objects for load in loads]
    asked = [*((question, 0.0) for question in questions), (questions[0], seconds)]
    return replace(chosen, scene=reduced(chosen.scene, fidelity, asked))
