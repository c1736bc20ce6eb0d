"""What precedes a run: earlier runs on an open simulated bench, and a bench file begun from a search.

What a simulated bench gives depends on everything that was done on it. So the header of a later run names the runs
before it, with their settings and calibrations. To resume it, they are carried out again on a new bench, and nothing of
them is stored. Time that passed between two runs passes again. Whatever else a script does with the bench between two
runs is known to nobody; then the later run cannot be resumed, and says so as it begins.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from palpate.drivers.scan import FoundDevice
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.kinds import DeviceKind
from palpate.instrument.bench.links import CanBus, Link, SerialLine, TcpLink
from palpate.instrument.config import check
from palpate.instrument.errors import ConfigError
from palpate.procedures.records.resumed import values_of
from palpate.procedures.records.run import Run

if TYPE_CHECKING:
    from palpate.simulators.bench import SimulatedBench


BEFORE = "before"  # header key; a run that begins on a bench as it was opened lacks it
AGAIN = (
    "procedure", "procedure_from", "started", "settings", "calibration", "film_calibration", "model_calibration",
    "mounting_scatter", "versions",
)  # fmt: skip
"""Keys of a run's header that are needed to carry the run out again."""


@dataclass(frozen=True, slots=True)
class Earlier:
    """A run that ended before another one began.

    Attributes:
        header: what of its header is needed to carry it out again.
        bench_ns: bench time at which it began [ns].
        paused: bench times of its pauses [ns].
        folder: its folder.
    """

    header: dict[str, Any]
    bench_ns: int
    paused: list[int]
    folder: str

    @property
    def run(self) -> Run:
        """The run by its header alone; its folder may be gone."""
        started = datetime.fromisoformat(self.header["started"]).astimezone(UTC)
        procedure = self.header["procedure"]
        return Run(Path(self.folder), procedure, True, started, "complete", self.header, {})


@dataclass(frozen=True, slots=True)
class Before:
    """Where a run began.

    Attributes:
        bench_ns: bench time [ns].
        state: digest of what does not change by waiting: the devices' settings, and when the rig was last touched.
        runs: the runs before it by their numbers.
        unknown: what was done besides, so that the run cannot be resumed; empty: nothing.
    """

    bench_ns: int
    state: str
    runs: dict[str, Earlier] = field(default_factory=dict)
    unknown: str = ""


def before_of(run: Run) -> Before | None:
    """Where a run began; None: on a bench as it was opened. Raises RecordError: its header does not tell."""
    found = run.header.get(BEFORE)
    if found is None:
        return None
    (before,) = values_of(Before, [found], f"{run.folder}: the runs before it")
    return before


class History:
    """What was done on an open simulated bench so far."""

    def __init__(self, simulated: SimulatedBench) -> None:
        self._simulated = simulated
        self._runs: dict[str, Earlier] = {}
        self._unknown = ""
        self._opened = self._left = self._now()

    def _now(self) -> Before:
        bench = self._simulated
        with bench.clock.lock:
            settings = {name: getattr(device, "settings", None) for name, device in bench.devices.items()}
            now, rig = bench.clock.now_ns(), bench.rig
            touched = (now - rig.settled_for_ns(), rig.exchanges, rig.position, rig.cell_position, len(rig.placed))
            state = json.dumps((touched, settings), sort_keys=True, default=str)
            return Before(now, hashlib.sha256(state.encode()).hexdigest())

    def begin(self) -> Before | None:
        """Where a run begins that begins now; None: on a bench as it was opened."""
        now = self._now()
        if now.state != self._left.state:
            run = f"after run {len(self._runs)}" if self._runs else "before its first run"
            self._unknown = self._unknown or f"something else was done with the bench {run}"
        if now == self._opened and not self._unknown:
            return None
        return Before(now.bench_ns, now.state, dict(self._runs), self._unknown)

    def wait_until(self, bench_ns: int) -> None:
        """Let time pass as it passed between two runs, up to a bench time [ns]; nothing if it is over."""
        self._simulated.clock.wait(1e-9 * max(0, bench_ns - self._simulated.clock.now_ns()))

    def end(self, header: Mapping[str, Any], begun_ns: int, paused: list[int], folder: Path) -> None:
        """A run has ended."""
        kept = json.loads(json.dumps({key: header[key] for key in AGAIN if key in header}))
        self._runs[str(len(self._runs) + 1)] = Earlier(kept, begun_ns, paused, str(folder))
        self._left = self._now()

    @property
    def now_ns(self) -> int:
        """Bench time [ns]."""
        return self._simulated.clock.now_ns()


# --- A bench file begun from what a search for devices has found ---------------------------------------

NAMES: dict[type[Link], tuple[str, str]] = {
    TcpLink: ("modbus-tcp", "tcp"),
    SerialLine: ("modbus-rtu", "line"),
    CanBus: ("canopen", "can"),
}  # fmt: skip


def begun_bench(found: Sequence[FoundDevice], kinds: Sequence[DeviceKind]) -> str:
    """The text of a bench file with each device that one kind fits; the others are comments in it.

    What such a file still lacks, as a kind for a device that is not known, stands in its first lines.
    """
    by_name = {kind.name: kind for kind in kinds}
    links: dict[str, dict[str, Any]] = {}
    devices: dict[str, dict[str, Any]] = {}
    unknown: list[str] = []
    for each in found:
        link = _link(links, each.link)
        place = {"link": link, "node" if each.kind == "canopen" else "unit": each.unit}
        if each.identified:
            kind = by_name[each.fits[0]]
            section = kind.key | place
            if kind.map is not None and each.kind != "modbus-tcp":
                section["set_to_link"] = True  # it answers with the settings of this link
            devices[_new(_plain(kind.name), devices)] = section
            continue
        possible = each.fits or each.candidates
        unknown += ["", f"# unit {each.unit} on {link} answers, and is not known: {each.says or 'it tells nothing'}"]
        unknown += [f"# could be: {' or '.join(possible) or 'no kind that has a map'}"]
        section = (by_name[possible[0]].key if possible else {"map": "FILE"}) | place
        lines = [f"[device.NAME_{each.unit}]", *(f"{key} = {_value(value)}" for key, value in section.items())]
        if not each.fits:
            lines.append('inventory = "LABEL"')
        unknown += [f"# {line}" for line in lines]
    used = {section["link"] for section in devices.values()}
    data = {
        "name": "my bench",
        "link": {name: table for name, table in links.items() if name in used},
        "device": devices,
    }
    text = tomli_w.dumps(data)
    waiting = [name for name in links if name not in used]
    for name in waiting:
        unknown += ["", *(f"# {line}" for line in tomli_w.dumps({"link": {name: links[name]}}).splitlines())]
    return "\n".join([*_still_to_do(data, devices), text.rstrip(), *unknown, ""])


def _still_to_do(data: dict[str, Any], devices: dict[str, Any]) -> list[str]:
    """Comments that say why the file cannot be used yet; none: it can."""
    if not devices:
        return ["# no device is known yet: see below"]
    try:
        check(dict(data), BenchDescription, "this file")
    except ConfigError as error:
        return ["# before it can be used:", *(f"# {line}" for line in str(error).splitlines())]
    return []


def _link(links: dict[str, dict[str, Any]], link: Link) -> str:
    """Name of a link, which is added if it is new."""
    kind, short = NAMES[type(link)]
    table = {"kind": kind} | link.model_dump(mode="json", exclude_defaults=True)
    table |= {key: getattr(link, key) for key in ("baudrate", "parity", "bitrate") if hasattr(link, key)}
    table.pop("timeout", None)  # that of a search is short
    for name, before in links.items():
        if before == table:
            return name
    name = _new(short, links)
    links[name] = table
    return name


def _new(wanted: str, taken: dict[str, Any]) -> str:
    """The wanted name, with a number where it is taken."""
    number, name = 1, wanted
    while name in taken:
        number += 1
        name = f"{wanted}_{number}"
    return name


def _plain(kind: str) -> str:
    return kind.replace("-", "_")[:36]


def _value(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value)
