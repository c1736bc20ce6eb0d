"""A recorded run that is done again on the traffic of its log."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any, get_args

from palpate.drivers.logs.bus_replay import BusReplay
from palpate.instrument.calibration.films import FilmCalibration
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.config import check, parse
from palpate.instrument.errors import ConfigError, PalpateError, UsageError
from palpate.procedures.commands.options import Choice, Output
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.engine.resumption import resumable
from palpate.procedures.lab.operator import Mounting
from palpate.procedures.logs.shown import described
from palpate.procedures.records.resumed import settings_of
from palpate.procedures.records.run import Run
from palpate.simulators.planning.settle import scene_of
from palpate.simulators.scenes.scene import Scene, SceneFile

KEPT = ("scene", "seed", "bench")  # of the header, as they were


class Replay:
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


def replay(log: Path, out: Path | None, output: Output) -> None:
    """Do the run of a log again.

    Raises:
        UsageError: no procedure of that name can be replayed.
        ConfigError: as `Replay`; or the procedure asks for what the log does not hold at that place.
    """
    recorded = Replay(log)
    known = resumable()
    if recorded.run.procedure not in known:
        raise UsageError(f"{log}: {recorded.run.procedure!r} cannot be replayed; valid: {', '.join(known)}")
    procedure = known[recorded.run.procedure]()
    settings = settings_of(recorded.run, procedure.settings)
    try:
        conduct(procedure, settings, Choice(None, None, None, out), output, replay=recorded)
    except PalpateError as error:
        error.__notes__ = []  # on outputs that cannot be switched off: there are none
        raise
