"""What a procedure is given: `Target`, to check its settings before the bench is opened, and `Lab`, to measure with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

from palpate.drivers.roles import SampleChanger, SensorNode
from palpate.instrument.bench.kinds import DeviceKind, Role, frequency_step
from palpate.instrument.calibration.calibration import UNKNOWN, CalibrationOwner
from palpate.instrument.calibration.films import FilmCalibration, MountingScatterCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.contracts.own import CHANNELS
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench
    from palpate.instrument.findings.object_modulus import ByReferences


# --- Who mounts the samples of a bench, and how long that takes ----------------------------------------

MOUNTING = 60.0  # s that a person takes to change the sample [A]


@dataclass(frozen=True, slots=True)
class Mounts:
    """Who mounts the samples of a bench, and how long that takes; a person, unless a sample changer does.

    Attributes:
        seconds: time of one mounting [s].
        changer: whether a sample changer mounts them.
    """

    seconds: float = MOUNTING
    changer: bool = False

    @property
    def again(self) -> float:
        """Time in which an object that lies there already is taken off and laid there anew [s].

        A changer leaves what it is told to lay and lies there already: it lays another sample in between.
        """
        return 2 * self.seconds if self.changer else self.seconds

    @property
    def person(self) -> float:
        """The part of a mounting that a person takes [s]."""
        return 0.0 if self.changer else self.seconds

    def described(self, mountings: int, again: bool = False) -> str:
        """Who takes how long of a plan for so many mountings, which are `again` those of one object; for people."""
        following = self.again if again else self.seconds
        seconds = self.seconds + (mountings - 1) * following
        return f"{'sample changer' if self.changer else 'person'} {seconds:g} s"


BY_HAND = Mounts()


def mounts_by(kind_in: Callable[[Role], DeviceKind | None]) -> Mounts:
    """Who mounts the samples of a bench; `kind_in` gives the kind that fills a role.

    A kind of changer that does not say how long it takes counts as long as a person.
    """
    changer = kind_in("sample_changer")
    return BY_HAND if changer is None else Mounts(changer.exchange or MOUNTING, changer=True)


# --- target and lab ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Target:
    """What is known of a bench before it is opened.

    Attributes:
        design: design of its sensor.
        force_limit: force limit, peak to peak [N].
        nodes: number of sensor nodes.
        model: sensor model of a simulated bench; None: the bench may be real.
        channels: number of channels of each node.
        frequency_step: step to which the bench rounds the frequency of a load [Hz]; None: unknown.
        travel: lowest position to which the positioner may go [m]; None: unknown.
        drivable: called with the frequency of a load [Hz]; raises RangeError or BenchError if the bench file tells that
            the bench cannot have such a load.
        calibrated: least and greatest load that the load cell is calibrated for, peak to peak [N]; None: the bench is
            not open yet.
        references: calibration by references of the model that the procedure asks; None: there is none, or the bench is
            not open yet.
        load_cell: calibration of the load cell; None: the bench is not open yet.
        scene: identity of the scene that simulates the bench; None: the bench may be real.
        mountings: scatter of the sensor's mountings; None: none is stored, or the bench is not open yet.
        mounts: who mounts samples, and how long that takes.
    """

    design: Design
    force_limit: float
    nodes: int
    model: str | None = None
    channels: int = CHANNELS
    frequency_step: float | None = None
    travel: float | None = None
    drivable: Callable[[float], object] = lambda _frequency: None
    calibrated: tuple[float, float] | None = None
    references: ByReferences | None = None
    load_cell: LoadCellCalibration | None = None
    scene: str | None = None
    mountings: MountingScatterCalibration | None = None
    mounts: Mounts = BY_HAND


def with_kinds(target: Target, kind_in: Callable[[Role], DeviceKind | None]) -> Target:
    """A target with what a bench's kinds say of their limits; `kind_in` gives the kind that fills a role."""
    positioner = kind_in("positioner")
    return replace(
        target,
        frequency_step=frequency_step(kind_in),
        travel=positioner.travel if positioner else None,
        mounts=mounts_by(kind_in),
    )


def owner(bench: Bench, role: type[Any], *of: str) -> CalibrationOwner:
    """Whose the calibrations of an open bench's device are; `of` is what else tells them apart."""
    return CalibrationOwner(bench.role(role).serial or UNKNOWN, bench.description.scene, bench.simulated, of)


@dataclass(frozen=True, slots=True)
class Lab:
    """An open bench and what a procedure needs to know about it.

    Attributes:
        bench: the open bench.
        design: design of the sensor, with the sensitivities of `films` if they are calibrated.
        calibration: calibration of the load cell.
        films: calibration of the films; None: the design's own sensitivities hold.
        run: name of the recorded run; empty: no run is recorded.
        started: when the run began.
        references: calibration by references of the model that the procedure asks; None: there is none.
        mountings: scatter of the sensor's mountings by an earlier run; None: none is stored.
    """

    bench: Bench
    design: Design
    calibration: LoadCellCalibration
    films: FilmCalibration | None = None
    run: str = ""
    started: datetime = field(default_factory=lambda: datetime.now(UTC))
    references: ModelCalibration | None = None
    mountings: MountingScatterCalibration | None = None

    @property
    def scene(self) -> str | None:
        """Identity of the scene that simulates the bench; None: it is a real one, or its file does not name it."""
        return self.bench.description.scene

    def origin(self, role: type[Any], valid_days: int) -> dict[str, Any]:
        """What a calibration of the device in a role tells of where it comes from: fields of `Calibration`.

        Args:
            role: the role.
            valid_days: days until it expires.
        """
        whose = owner(self.bench, role)
        return {
            "device": whose.device,
            "scene": whose.scene,
            "simulated": whose.simulated,
            "source": self.run,
            "created": self.started.isoformat(timespec="seconds"),
            "expires": (self.started + timedelta(days=valid_days)).date().isoformat(),
        }

    @property
    def same_films(self) -> bool:
        """Whether `references` were measured with the films' calibration that holds now, so that its error cancels."""
        return self.references is not None and self.references.film_calibration == self.film_hash

    @property
    def film_hash(self) -> str | None:
        """SHA-256 of the films' calibration; None: the design's own sensitivities hold."""
        return None if self.films is None else self.films.sha256()

    @property
    def target(self) -> Target:
        """The limits against which procedures check their settings."""
        nodes = self.bench.all(SensorNode)
        channels = self.bench.named(nodes[0]).kind.channels if nodes else CHANNELS
        covered = self.calibration.least_N, self.calibration.greatest_N
        target = Target(self.design, self.bench.force_limit, len(nodes), channels=channels, calibrated=covered)
        target = replace(target, references=self._by_references(), load_cell=self.calibration, mountings=self.mountings)
        target = with_kinds(target, self.bench.description.kind_in)
        return target if self.bench.maybe(SampleChanger) else replace(target, mounts=BY_HAND)

    def _by_references(self) -> ByReferences | None:
        if self.references is None:
            return None
        from palpate.instrument.findings.object_modulus import ByReferences

        return ByReferences(self.references, self.same_films)


@dataclass(frozen=True, slots=True)
class Dwells:
    """Settled load sets of one frequency.

    Attributes:
        objects: the samples or other objects.
        loads: least and greatest load, peak to peak [N].
        frequency: frequency of the load [Hz].
        dwell: shortest dwell [s].
    """

    objects: Sequence[Sample]
    loads: tuple[float, float]
    frequency: float
    dwell: float
