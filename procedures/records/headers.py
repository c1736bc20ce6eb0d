"""Reads the header of a procedure's run: its settings, its bench, and its differences from another header."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError

from palpate.instrument.bench.comparison import compared
from palpate.instrument.bench.description import BenchDescription, recorded_bench
from palpate.instrument.errors import ConfigError, RecordError, quoted
from palpate.instrument.refusals import wrong
from palpate.procedures.records.run import Run

COMPARED = ("settings", "scene", "bench", "devices", "contracts", "calibration", "film_calibration", "versions")

T = TypeVar("T")


class _Scene(BaseModel):
    toml: str


class _Header(BaseModel):
    """Header of a procedure's record on a bench; see `procedures/lab/open.py`."""

    settings: dict[str, Any]
    scene: _Scene | None
    bench: str
    devices: dict[str, str]
    contracts: str
    calibration: dict[str, Any]
    film_calibration: dict[str, Any] | None
    versions: dict[str, str]


def header_of(run: Run) -> Mapping[str, Any]:
    """The header of a run that a procedure began on a bench. Raises RecordError: the run has another kind of header."""
    header: Mapping[str, Any] = run.header
    try:
        _Header.model_validate(header, strict=True)
        tomllib.loads(header["bench"] if header["scene"] is None else header["scene"]["toml"])
    except ValidationError as error:
        reason = _first(error)
    except tomllib.TOMLDecodeError as error:
        reason = str(error)
    else:
        return header
    raise RecordError(f"{run.folder}: its header is not that of a procedure on a bench ({reason}); run anew")


def settings_of(run: Run, kind: type[T]) -> T:
    """The settings of a run, as their dataclass. Raises RecordError."""
    (settings,) = values_of(kind, [run.header["settings"]], f"{run.folder}: its settings")
    return settings


def _first(error: ValidationError) -> str:
    first: Mapping[str, Any] = dict(error.errors(include_url=False)[0])
    key = ".".join(map(str, first["loc"]))
    return f"{key}: is missing" if first["type"] == "missing" else f"{key}: {quoted(first['input'])} {wrong(first)}"


def changes(before: Mapping[str, Any], now: Mapping[str, Any], where: str) -> list[str]:
    """How a header differs from that of a record, where it must not; `where` names the record in messages.

    Raises:
        RecordError: the record's bench cannot be read.
    """
    parts = comparable(before), comparable(now)
    # A package that the record does not name cannot be compared: older versions of palpate did not record all packages.
    parts[1]["versions"] = {package: now["versions"].get(package) for package in before["versions"]}
    if before["scene"] is None:
        known, here = (_bench(header, where) for header in (before, now))
        parts[0]["bench"], parts[1]["bench"] = compared(known, here)
    return list(differences(*parts))


def comparable(header: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a header that must not change. A simulated bench has new addresses; its scene counts."""
    found = {key: header[key] for key in COMPARED}
    found["maps"] = header.get("maps", {})  # a bench without makers' devices has none
    found["model_calibration"] = header.get("model_calibration")  # of runs that ask a model which references calibrated
    found["before"] = header.get("before")  # of runs that did not begin on a bench as it was opened
    found["devices"] = {}
    listed = [(name.partition(" at ")[0], serial) for name, serial in header["devices"].items()]
    if found["scene"] is not None:
        listed.sort()  # they stand in the order of their addresses, which a simulated bench has anew each time
    for title, serial in listed:
        several = sum(known.partition(" #")[0] == title for known in found["devices"])
        found["devices"][f"{title} #{several + 1}" if several else title] = serial
    if found["scene"] is not None:
        found["scene"] = tomllib.loads(found["scene"]["toml"])
    del found["bench"]
    return found


def _bench(header: Mapping[str, Any], where: str) -> BenchDescription:
    """The bench of a header. Raises RecordError."""
    try:
        return recorded_bench(header["bench"], f"{where}: its bench file")
    except ConfigError as error:
        raise RecordError(f"{error}; run anew, or install what is missing") from None


def differences(before: Any, now: Any, key: str = "") -> Iterator[str]:
    """One text for each value that differs, with its key."""
    if isinstance(before, dict) and isinstance(now, dict):
        for name in dict.fromkeys((*before, *now)):
            yield from differences(before.get(name), now.get(name), f"{key}.{name}" if key else name)
    elif before != now:
        yield f"{key}: {json.dumps(before)} in the record, {json.dumps(now)} now"


def values_of(kind: type[T], data: list[Any], what: str) -> list[T]:
    """Dataclasses of JSON `data`; `what` names it in messages. Raises RecordError: it is of other fields."""
    try:
        return _as(kind, data)
    except ValidationError as error:
        raise RecordError(f"{what} were recorded by another version of palpate ({_first(error)}); run anew") from None


def _as(kind: type[T], data: list[Any]) -> list[T]:
    """Turn JSON `data` into dataclasses; a null in the place of a number becomes NaN."""
    adapter = TypeAdapter(list[kind])  # type: ignore[valid-type]
    try:
        return adapter.validate_python(data)
    except ValidationError as error:
        nulls = [tuple(e["loc"]) for e in error.errors(include_url=False) if e["input"] is None]
        if not nulls:
            raise
        try:
            for *path, last in nulls:
                where: Any = data
                for part in path:
                    where = where[part]
                where[last] = float("nan")
        except (LookupError, TypeError):  # no number belongs there
            raise error from None
    return adapter.validate_python(data)
