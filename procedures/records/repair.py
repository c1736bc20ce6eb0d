"""Repair of a damaged run: everything whole is written into a new run, which says what is lost."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.instrument.errors import RecordError
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import is_format4, last_modified
from palpate.procedures.records.salvage import Left, salvaging

ENDED = ("complete", "stopped", "failed")
UNKNOWN = "unknown"  # procedure of a run whose header is lost


@dataclass(frozen=True, slots=True)
class Repaired:
    """Result of a repair: folder, points and waveforms of the new run, losses, and whether the old one was hashed."""

    folder: Path
    points: int
    waveforms: int
    gone: list[str]
    hashed: bool


def repair(folder: Path, out: Path) -> Repaired:
    """Write every whole row of the run in `folder` into a new run in `out`.

    Points are numbered anew where some are lost. The new run is complete only where the old one was complete and
    nothing is lost; otherwise it is stopped and has no summary.

    Raises:
        RecordError: nothing can be saved, or `out` cannot be written to.
        UsageError: `out` holds a run.
    """
    folder = folder.absolute()
    hashed = is_format4(folder)
    with salvaging(folder) as left:
        if not (left.header or left.points or left.events):
            raise RecordError(f"nothing can be salvaged: {folder} has no whole row")
        header = _header(left, folder)
        header["repaired"] = {"from": str(folder), "hashed": hashed, "gone": left.gone}
        kept = 0
        with Recorder.create(out, header) as record:
            for bench_ns, kind, message in left.events.values():
                record.event(kind, message, bench_ns)
            for number, point in left.points.items():
                waveforms = left.waveforms(number)
                record.point(point.data, waveforms, point.bench_ns)
                kept += len(waveforms)
            if left.gone or left.status not in ENDED:
                gone = "; ".join(left.gone) or "nothing, but it had not ended"
                record.finish("stopped", {}, f"repaired; gone: {gone}")
            else:
                record.finish(left.status, left.summary, "repaired; nothing is gone")  # type: ignore[arg-type]
        return Repaired(out.absolute(), len(left.points), kept, left.gone, hashed)


def _header(left: Left, folder: Path) -> dict[str, Any]:
    """What is left of the header. Required entries that are lost are replaced and listed as lost."""
    header = dict(left.header)
    made_up = {
        "procedure": UNKNOWN,
        "simulated": left.simulated is not False,  # a simulated run must not pass for a real one
        "started": last_modified(folder).isoformat(timespec="seconds"),
    }
    for key, value in made_up.items():
        if key not in header:
            header[key] = value
        if key not in left.header and not (key == "simulated" and left.simulated is not None):
            left.gone.append(f"{key!r} of the header, now {value!r}")
    return header
