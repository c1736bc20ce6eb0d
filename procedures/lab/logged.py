"""A run read from a bus log, to replay it: its settings and calibrations, and what the devices answered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self, get_args

from palpate.instrument.calibration.films import FilmCalibration, MountingScatterCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.config import check, parse
from palpate.instrument.errors import ConfigError
from palpate.procedures.lab.operator import Mounting
from palpate.procedures.records.run import Run
from palpate.simulators.planning.settle import scene_of
from palpate.simulators.scenes.scene import Scene, SceneFile

KEPT = ("scene", "seed", "bench")  # keys of the header that a replay takes over unchanged


@dataclass(frozen=True, slots=True)
class Used:
    """What a recorded run knew of its sensor from earlier runs.

    Attributes:
        calibration: the load-cell calibration that it used.
        films: the film calibration that it used; None: it used none.
        references: the calibration of a model by references that it used; None: it used none.
        mountings: the scatter of the sensor's mountings that was stored when it began; None: none was.
    """

    calibration: LoadCellCalibration
    films: FilmCalibration | None
    references: ModelCalibration | None
    mountings: MountingScatterCalibration | None

    @classmethod
    def of(cls, header: Mapping[str, Any], where: str) -> Self:
        """By the header of the run. Raises KeyError: it lacks one; ConfigError: one is wrong."""
        films, references = header["film_calibration"], header.get("model_calibration")
        return cls(
            load_cell_in(header, where),
            None if films is None else check(films, FilmCalibration, where),
            None if references is None else check(references, ModelCalibration, where),
            mountings_in(header, where),
        )


class LoggedRun:
    """The run in a bus log.

    Attributes:
        wire: the logged traffic, which answers in place of the devices.
        run: the run as it began.
        used: what it knew from earlier runs.
        scene: the scene that it simulated; None: it ran on a real bench.
    """

    def __init__(self, log: Path) -> None:
        """Raises ConfigError: the file is damaged or from another version. RecordError: it cannot be read."""
        from palpate.drivers.logs.bus_replay import BusReplay
        from palpate.procedures.logs import described

        self.wire = BusReplay(log, described)
        header, where = self.wire.run, str(self.wire.path)
        try:
            started = datetime.fromisoformat(header["started"]).astimezone(UTC)
            self.run = Run(self.wire.path, header["procedure"], header["simulated"], started, "running", header, {})
            self.used = Used.of(header, where)
            self.scene = scene_in(header, self.wire.path)
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(
                f"{where}: the run in this log was recorded by another version of palpate ({error}); replay it with "
                "that version"
            ) from None

    @property
    def mounting(self) -> Mounting:
        """How the run knew what was mounted."""
        return mounting_in(self.run.header)

    @property
    def header(self) -> dict[str, Any]:
        """Keys of a replay's record header that differ from those of a new run."""
        return {
            **{key: self.run.header[key] for key in KEPT},
            "mounting": self.mounting,
            "replayed": str(self.wire.path),
        }


def scene_in(header: Mapping[str, Any], path: Path) -> Scene | None:
    """The scene of a run, from its header in a file; None: it ran on a real bench. Raises ConfigError: it is wrong."""
    scene = header["scene"]
    return None if scene is None else scene_of(parse(scene["toml"].encode(), SceneFile, str(path)), path)


def mounting_in(header: Mapping[str, Any]) -> Mounting:
    """How a run knew what was mounted, from its header."""
    unsaid: Mounting = "assumed" if header["scene"] is None else "simulated"
    return next((each for each in get_args(Mounting) if each == header.get("mounting")), unsaid)


def load_cell_in(header: Mapping[str, Any], where: str) -> LoadCellCalibration:
    """The load-cell calibration with which a run began, from its header. Raises ConfigError: it is wrong."""
    return check(header["calibration"], LoadCellCalibration, where)


def mountings_in(header: Mapping[str, Any], where: str) -> MountingScatterCalibration | None:
    """The scatter of mountings that was stored when a run began, from its header. Raises ConfigError: it is wrong."""
    found = header.get("mounting_scatter")
    return None if found is None else check(found, MountingScatterCalibration, where)
