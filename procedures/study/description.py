"""Description of a study: a grid or random draws over scenes, seeds, designs, models, materials and effects.

study = read_study(Path("study.toml"))
len(study), study.cell(7)           # {"scene": "thesis_single", "seed": 8, "sample": "2"}
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, Literal

from pydantic import Field

from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.config import Config, Name, check, read
from palpate.instrument.errors import ConfigError, PalpateError, RangeError, UnknownName
from palpate.instrument.models.table import MODELS
from palpate.instrument.quantity import Hertz, Seconds, parse
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES, parse_samples
from palpate.procedures.steps.checks import check_force, check_frequency, check_time, parse_loads

Value = str | int | float | bool
CLOSED_FORM: Final = "closed form"
BENCH: Final = "bench"
AXES = ("scene", "seed", "design", "model", "sample", "modulus")  # and effects.NAME.PARAMETER
EFFECTS = "effects."
DEFAULTS: Mapping[str, Value] = {"scene": "thesis_single", "sample": "2"}
VALID: Mapping[str, Sequence[str]] = {"model": tuple(MODELS), "sample": tuple(SAMPLES)}
MOST_CELLS, MOST_POINTS = 10_000_000, 100_000_000
LARGEST_SEED = 2**63 - 1
DIGITS = 6  # digits of a number that is drawn from a range


class RandomFile(Config):
    """Random draws instead of the whole grid."""

    cells: int = Field(ge=1, le=MOST_CELLS, strict=True)
    seed: int = Field(default=1, ge=0, le=LARGEST_SEED, strict=True)


class StudyFile(Config):
    """The TOML file of a study."""

    file: ClassVar[str] = "study"

    name: Name
    how: Literal["closed form", "bench"] = CLOSED_FORM
    loads: str = "1.5 N:4 N:0.5 N"
    frequency: Hertz = 10.0
    dwell: Seconds = 1.0
    random: RandomFile | None = None
    axes: dict[str, Any] = Field(min_length=1)  # a list, "1-100" of seeds or samples, {low, high, scale} to draw from


class _Range(Config):
    """Range of numbers, or of quantities with one unit."""

    low: str | float
    high: str | float
    scale: Literal["linear", "log"] = "linear"


@dataclass(frozen=True, slots=True)
class Span:
    """Numbers from `low` to `high` with a unit, drawn evenly or by their logarithm."""

    low: float
    high: float
    unit: str
    log: bool

    def at(self, share: float) -> Value:
        """The value at a share of the way from `low` to `high`, 0 to 1."""
        value = self.low + (self.high - self.low) * share
        if self.log:
            value = self.low * (self.high / self.low) ** share
        rounded = float(f"{value:.{DIGITS}g}")
        return f"{rounded!r} {self.unit}" if self.unit else rounded


Axis = Sequence[Value] | Span


@dataclass(frozen=True, slots=True)
class Study:
    """A checked study.

    Attributes:
        axes: values of each thing that varies, or a span to draw them from.
        loads: loads of each cell, peak to peak [N].
        file: the study's file as it was read.
    """

    axes: Mapping[str, Axis]
    loads: tuple[float, ...]
    file: StudyFile

    def __len__(self) -> int:
        """Number of cells."""
        return self.file.random.cells if self.file.random else math.prod(self.shape)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values on each axis of a grid."""
        return tuple(len(axis) for axis in self.axes.values() if not isinstance(axis, Span))

    def scenes(self) -> int:
        """Number of cells that differ in more than their seeds; where cells are drawn, as many as there are cells."""
        return len(self) if self.file.random else len(self) // len(self.axes.get("seed", [0]))  # type: ignore[arg-type]

    def cell(self, number: int) -> dict[str, Value]:
        """Values of cell `number`, from 0, on all axes, and the defaults. In a grid the last axis varies fastest."""
        return {**DEFAULTS, **self.varied(number)}

    def varied(self, number: int) -> dict[str, Value]:
        """Values of a cell on the varied axes alone."""
        draw = self.file.random
        if draw is None:
            found: dict[str, Value] = {}
            for name in reversed([*self.axes]):
                axis = self.axes[name]
                assert not isinstance(axis, Span)
                number, place = divmod(number, len(axis))
                found[name] = axis[place]
            return dict(reversed(found.items()))
        drawn = {}
        for name, axis in self.axes.items():
            share = random.Random(f"{draw.seed} {number} {name}").random()  # equal in every version of Python
            drawn[name] = axis.at(share) if isinstance(axis, Span) else axis[int(share * len(axis))]
        return drawn


def read_study(path: Path) -> Study:
    """Read the study in a TOML file. Raises ConfigError, which names file and key."""
    return study_of(read(path, StudyFile), str(path))


def study_of(file: StudyFile, where: str) -> Study:
    """A checked study; `where` is what messages call it. Raises ConfigError."""
    try:
        loads = parse_loads(file.loads)
        check_force(loads, BenchDescription.model_fields["force_limit"].default)
        check_frequency(file.frequency, None)  # the steps are checked by scene
        check_time(file.dwell, file.frequency)
    except PalpateError as error:
        raise ConfigError(f"{where}: {error}") from None
    axes = {}
    for name, given in _flat(file.axes).items():
        try:
            axes[name] = _axis(name, given, file)
        except PalpateError as error:
            raise ConfigError(f"{where}: axes.{name}: {error}") from None
    study = Study(axes, loads, file)
    if len(study) > MOST_CELLS or len(study) * len(loads) > MOST_POINTS:
        raise ConfigError(
            f"{where}: {len(study)} cells of {len(loads)} loads are more than the {MOST_CELLS} cells and {MOST_POINTS}"
            " points that a study may have; shorten an axis, or draw some with [random]"
        )
    return study


def _flat(tables: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Values of nested tables by their dotted keys. A range counts as a value."""
    flat: dict[str, Any] = {}
    for key, value in tables.items():
        name = f"{before}{key}"
        if isinstance(value, dict) and value.keys().isdisjoint(("low", "high")):
            flat.update(_flat(value, f"{name}."))
        else:
            flat[name] = value
    return flat


def _axis(name: str, given: Any, file: StudyFile) -> Axis:
    if name not in AXES and not name.startswith(EFFECTS):
        raise UnknownName("axis", name, (*AXES, "effects.NAME.PARAMETER"))
    if name == "modulus" and file.how == BENCH:
        raise RangeError(f"a bench mounts samples by their names; take the axis sample, or how = {CLOSED_FORM!r}")
    if isinstance(given, dict):
        if file.random is None:
            raise RangeError("a range is drawn from; add [random] with its cells, or give a list")
        return _span(name, given)
    values: Sequence[Any] = given
    if isinstance(given, str):
        values = _listed(name, given)
    if not isinstance(values, (list, tuple, range)) or not len(values):
        raise RangeError(f"{given!r} is no list of values, so that there is nothing to vary; give for example [1, 2]")
    if not isinstance(values, range):
        for value in values:
            _check_value(name, value)
        if len(set(map(repr, values))) < len(values):
            raise RangeError("a value is given twice; give each once")
    return values


def _listed(name: str, text: str) -> Sequence[Value]:
    """ "1-100" of seeds, "1-6" of samples."""
    if name == "sample":
        return parse_samples(text)
    first, dash, last = text.partition("-")
    if (
        name != "seed"
        or not (dash and first.isdecimal() and last.isdecimal())
        or len(text) > 2 * len(str(LARGEST_SEED))
    ):
        raise RangeError(f"{text!r} is no list of values; give for example ['a', 'b'], or of seeds '1-100'")
    low, high = int(first), int(last)
    if not low <= high <= LARGEST_SEED or high - low >= MOST_POINTS:
        raise RangeError(f"seeds {text!r} run backwards, beyond {LARGEST_SEED}, or are more than {MOST_POINTS}")
    return range(low, high + 1)


def _check_value(name: str, value: Any) -> None:
    if name == "seed":
        if type(value) is not int or not 0 <= value <= LARGEST_SEED:
            raise RangeError(f"{value!r} is no seed; give a whole number from 0 to {LARGEST_SEED}")
    elif name == "design":
        get_design(str(value))
    elif name in VALID:
        if value not in VALID[name]:
            raise UnknownName(name, value, VALID[name])
    elif name == "modulus":
        if not (isinstance(value, str) and parse(value, "Pa") > 0):
            raise RangeError(f"{value!r} is no modulus; give a text such as '24 kPa', above 0")
    elif name == "scene":
        if not isinstance(value, str):
            raise RangeError(f"{value!r} is no scene; give its name or file")
    elif not isinstance(value, (str, int, float)) or (isinstance(value, float) and not math.isfinite(value)):
        raise RangeError(f"{value!r} is no value of a parameter; give a number, or a text with its unit")


def _span(name: str, given: dict[str, Any]) -> Span:
    span = check(given, _Range, "range")
    if name in VALID or name in ("seed", "scene", "design"):
        raise RangeError("has no range to draw from; give a list")
    (low, unit), (high, other) = (parted(end) for end in (span.low, span.high))
    if unit != other:
        raise RangeError(f"range from {span.low!r} to {span.high!r} has two units; give both ends in one")
    if not low < high or (span.scale == "log" and not low > 0):
        above = ", above 0 where its scale is 'log'" if span.scale == "log" else ""
        raise RangeError(f"range from {span.low!r} to {span.high!r} does not increase{above}; change its ends")
    _check_value(name, span.low)
    return Span(low, high, unit, span.scale == "log")


def parted(value: str | float) -> tuple[float, str]:
    """Number and unit. Raises RangeError: not a number with its unit."""
    if not isinstance(value, str):
        return float(value), ""
    number, _, unit = value.strip().partition(" ")
    try:
        finite = float(number)
    except ValueError:
        finite = math.nan
    if not (math.isfinite(finite) and unit):
        raise RangeError(f"{value!r} is no number with a unit after a space; give for example '24 kPa'")
    return finite, unit
