"""The run in a log of its traffic: what it was begun with, and what the devices answered."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any, get_args

from palpate.drivers.logs.bus_replay import BusReplay
from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.config import check, parse
from palpate.instrument.errors import ConfigError
from palpate.procedures.lab.operator import Mounting
from palpate.procedures.logs.shown import described
from palpate.procedures.records.run import Run
from palpate.simulators.planning.settle import scene_of
from palpate.simulators.scenes.scene import Scene, SceneFile

KEPT = ("scene", "seed", "bench")  # of the header, as they were


class LoggedRun:
    """A log, and what is known of the run in it.

    Attributes:
        wire: its traffic.
        run: as it was begun.
        calibration, films: that it used.
    """

    def __init__(self, log: Path) -> None:
        """Raises ConfigError: the file is damaged, or of another palpate. RecordError: it cannot be read."""
        self.wire = BusReplay(log, described)
        header, where = self.wire.run, str(self.wire.path)
        try:
            started = datetime.fromisoformat(header["started"]).astimezone(UTC)
            self.run = Run(
                self.wire.path, header["procedure"], header["simulated"], started, "running", header, {}, hashed=True
            )
            self.calibration = check(header["calibration"], LoadCellCalibration, where)
            films = header["film_calibration"]
            self.films = None if films is None else check(films, FilmCalibration, where)
            scene = header["scene"]
            self.scene = None if scene is None else _scene(scene["toml"], self.wire.path)
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"{where}: its run is of another palpate ({error}); replay with that one") from None

    @property
    def mounting(self) -> Mounting:
        """How it was known what was mounted."""
        said = self.run.header.get("mounting")
        unsaid: Mounting = "assumed" if self.scene is None else "simulated"
        return next((known for known in get_args(Mounting) if known == said), unsaid)

    @property
    def header(self) -> dict[str, Any]:
        """What the record of a replay says otherwise than that of a run."""
        return {
            **{key: self.run.header[key] for key in KEPT},
            "mounting": self.mounting,
            "replayed": str(self.wire.path),
            "replay_verified": self.wire.verified,
        }


def _scene(toml: str, path: Path) -> Scene:
    return scene_of(parse(toml.encode(), SceneFile, str(path)), path)
