"""The record of a run on an open bench: where it lies, what it says of the bench, and how it ends."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import NotRequired, TypedDict

from palpate.drivers.bench import Bench
from palpate.drivers.logs.bus_log import check_log
from palpate.instrument.contracts import contracts_digest
from palpate.instrument.errors import UsageError
from palpate.instrument.models.evidence import of_experiment, ratio_by
from palpate.procedures.arithmetic import arithmetic
from palpate.procedures.console.terminal import say
from palpate.procedures.lab.lab import Lab
from palpate.procedures.lab.open import Calibrating, OpenBench
from palpate.procedures.lab.operator import Mounting, weaker
from palpate.procedures.lab.software import commit, versions
from palpate.procedures.lab.store import result_folder
from palpate.procedures.records.encoding import as_json
from palpate.procedures.records.record import Recorder, put_file
from palpate.procedures.records.resumed import Resumed


class Outcome(TypedDict):
    """What every result says of itself, under public names."""

    simulated: bool
    run: str
    design: str
    scene: str | None
    model: str | None
    parameter_set: str | None
    evidence: str | None
    seed: int | None
    calibration: str
    film_calibration: str | None
    calibration_files: dict[str, object]
    mounting: Mounting
    bench_seconds: float
    wall_seconds: float
    calibration_file: NotRequired[str]
    certificate: NotRequired[str]
    film_calibration_file: NotRequired[str]


class Kept(TypedDict, total=False):
    """What an outcome says, in addition or instead, of a calibration that came out."""

    calibration: str
    film_calibration: str
    calibration_file: str
    certificate: str
    film_calibration_file: str


@dataclass(frozen=True, slots=True)
class Session:
    """A run that is being recorded on an open bench."""

    opened: OpenBench
    lab: Lab
    record: Recorder
    mounting: Mounting

    @property
    def bench(self) -> Bench:
        """Of its lab."""
        return self.lab.bench

    @property
    def model(self) -> str | None:
        """The sensor model that the scene's force ratios come from; None: nothing is simulated."""
        return self.opened.scene.model if self.opened.scene else None

    def outcome(self) -> Outcome:
        """What its result says of itself."""
        scene, lab = self.opened.scene, self.lab
        return {
            "simulated": lab.bench.simulated,
            "run": str(self.record.folder),
            "design": lab.design.name,
            "scene": scene.name if scene else None,
            "model": self.model,
            "parameter_set": scene.file.parameters if scene else None,
            "evidence": None if self.model is None else of_experiment("force_ratio", ratio_by(self.model)).value,
            "seed": scene.seed if scene else None,
            "calibration": f"{lab.calibration.source}{lab.calibration.marks()}",
            "film_calibration": f"{lab.films.source}{lab.films.marks()}" if lab.films else None,
            "calibration_files": _calibration_files(lab),
            "mounting": self.mounting,
            "bench_seconds": lab.bench.clock.now_ns() / 1e9,
            "wall_seconds": time.monotonic() - self.opened.wall_start,
        }


def _calibration_files(lab: Lab) -> dict[str, object]:
    """What a run says of the files of its calibrations."""
    return {"load_cell": lab.calibration.about(), "films": None if lab.films is None else lab.films.about()}


@contextmanager
def places(out: Path | None, log: Path | None, procedure: str, started: datetime) -> Iterator[Path]:
    """The folder of a run; its log can be written, too. Raises UsageError, RecordError as `result_folder`."""
    with result_folder(out, procedure, started) as folder:
        if log is not None:
            check_log(log)
        yield folder


@contextmanager
def recording(
    opened: OpenBench,
    procedure: str,
    settings: Mapping[str, object],
    folder: Path,
    *,
    calibrating: Calibrating | None = None,
    by_hand: str = "",
    resumed: Resumed | None = None,
) -> Iterator[Session]:
    """Begin a run on an open bench, or go on with one. If the block fails, outputs are off before the record says so.

    Raises:
        UsageError: the folder holds a run, nobody could confirm what is mounted, another bench than that of the run
            which is to go on; an earlier run on this bench failed, or is in its log.
        ConfigError: a calibration is wrong. RecordError: the folder cannot be written.
    """
    if opened.runs and (opened.log is not None or not opened.bench.is_open):
        why = "its log holds one run" if opened.bench.is_open else "it was closed when a run on it failed"
        raise UsageError(f"no other run can begin on this bench: {why}; open it anew")
    logged, scene = opened.chosen.logged, opened.scene
    mounting = opened.chosen.mounting(by_hand)
    started = datetime.now(UTC) if opened.runs else opened.started
    lab = opened.lab(folder.name, started, calibrating)
    header = {
        "procedure": procedure,
        "simulated": lab.bench.simulated,
        "started": started.isoformat(timespec="seconds"),
        "settings": dict(settings),
        "scene": None
        if scene is None
        else {"name": scene.name, "model": scene.model, "why": scene.why, "toml": scene.to_toml()},
        "seed": None if scene is None else scene.seed,
        "bench": lab.bench.description.to_toml(),
        "mounting": mounting,
        "devices": {device.name: device.serial for device in lab.bench.devices},
        "contracts": contracts_digest(lab.bench.description.contracts),
        "calibration": lab.calibration.model_dump(),
        "film_calibration": lab.films.model_dump() if lab.films else None,
        "calibration_files": _calibration_files(lab),
        "versions": versions(),
        "arithmetic": arithmetic(),
        "commit": commit(),
        **(logged.header if logged is not None else {}),
    }
    opened.runs.append(folder)
    with ExitStack() as stack:
        if opened.log is not None:
            opened.log.describe(as_json(header))
        if resumed is None:
            record = stack.enter_context(Recorder.create(folder, header))
        else:
            header["mounting"] = mounting = weaker(resumed.run.header.get("mounting"), mounting)
            resumed.begin(header)
            record = stack.enter_context(resumed)
        failing = stack.enter_context(ExitStack())  # left before the record, whose disk may be slow
        failing.push(lab.bench)
        lab.bench.attend(record.event)
        for caution in lab.bench.cautions:
            say(f"palpate: note: {caution}", err=True)
            record.event("caution", caution, lab.bench.clock.now_ns())
        put_file(folder / "bench.toml", str(header["bench"]))
        if scene is not None:
            put_file(folder / "scene.toml", scene.to_toml())
        try:
            yield Session(opened, lab, record, mounting)
        except BaseException as error:
            if record.points:
                remedy = "" if logged else f"; go on with: palpate runs resume {record.folder}"
                error.add_note(f"points already taken are kept in {record.folder}{remedy}")
            raise
        failing.pop_all()
        lab.bench.incidents.hold()
