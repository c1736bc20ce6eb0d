"""References: objects whose Young modulus is known, by a statement or by a compression test.

read_reference("A: 48 kPa ± 2 %")
read_reference("A: runs/20261123T101500Z-test-modulus")
"""

from __future__ import annotations

import math
import re
import tomllib
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.config import check
from palpate.instrument.errors import ConfigError, QuantityError, RangeError, RecordError, UsageError, quoted
from palpate.instrument.quantity import parse, show
from palpate.instrument.sensor.sample import SAMPLES, Sample, get_sample
from palpate.instrument.uncertainty.budget import NORMAL_FACTOR, coverage_factor
from palpate.procedures.lab.store import store
from palpate.procedures.measurements.modulus.procedure import ModulusTest
from palpate.procedures.measurements.modulus.result import DisplaysPoint
from palpate.procedures.measurements.softness.procedure import object_of
from palpate.procedures.records.resumed import values_of
from palpate.procedures.records.run import Run, find_run

STATED = "stated"
LARGEST = 0.5  # relative standard uncertainty of a reference's modulus; more tells nothing of a model
EXAMPLE = "write for example 'A: 48 kPa ± 2 %', or 'A: runs/NAME' of a run of palpate test modulus"
_NAME = re.compile(r"[\w.-]+(?: [\w.-]+)*")
_BETWEEN = re.compile(r"±|\+/-|\+-")


@dataclass(frozen=True, slots=True)
class Reference:
    """An object of known modulus.

    Attributes:
        name: name of the object.
        modulus: Young modulus [Pa].
        u: relative standard uncertainty of the modulus.
        source: "stated", or the name of the run that measured it.
        digest: digest of that run; empty: it is stated.
        sample: rubber sample that it is; empty: none.
        simulated: whether a simulated bench measured it; None: it is stated.
        scene: identity of the scene that simulated that bench.

    Raises:
        UsageError: the name has other characters than letters, digits, spaces and ._-, or more than 40.
        RangeError: the modulus is not above 0 and finite, or the uncertainty is not above 0 or above 50 %.
    """

    name: str
    modulus: float
    u: float
    source: str = STATED
    digest: str = ""
    sample: str = ""
    simulated: bool | None = None
    scene: str | None = None

    def __post_init__(self) -> None:
        if len(self.name) > 40 or not _NAME.fullmatch(self.name):
            raise UsageError(f"name {quoted(self.name)} of a reference: give letters, digits, single spaces, or ._-")
        if not 0 < self.modulus < math.inf:
            raise RangeError(
                f"modulus {self.modulus:g} Pa of reference {self.name!r} is not above 0 and finite; give a positive one"
            )
        if not 0 < self.u <= LARGEST:
            raise RangeError(
                f"uncertainty {100 * self.u:.4g} % of reference {self.name!r} is not above 0 and at most"
                f" {100 * LARGEST:g} %; give the standard uncertainty of its modulus, or another reference"
            )

    @property
    def told(self) -> str:
        """Where the modulus comes from, for people and the file."""
        return f"{self.source}, digest {self.digest[:12]}" if self.digest else self.source

    def object(self, thickness: float) -> Sample:
        """What is mounted: on a simulated bench a rubber sample, or an object of the stated modulus."""
        if self.sample:
            return replace(get_sample(self.sample), name=self.name)
        return object_of(self.modulus, thickness, self.name)


def read_reference(text: str) -> Reference:
    """The reference of a text: its name, and its modulus with a standard uncertainty, or a run that measured it.

    Raises:
        UsageError: the text is no reference, or the run is no complete test of a modulus.
        QuantityError, RangeError: modulus or uncertainty are no quantity, or outside their limits.
        UnknownName: there is no such run. RecordError: it is damaged.
    """
    name, _, rest = (part.strip() for part in text.partition(":"))
    if not name or not rest:
        raise UsageError(f"{quoted(text)} is no reference; {EXAMPLE}")
    modulus, *uncertainty = (part.strip() for part in _BETWEEN.split(rest))
    if len(uncertainty) == 1:
        return _stated(name, parse(modulus, "Pa", "48 kPa"), uncertainty[0])
    if not _is_quantity(modulus, "Pa") and not _is_quantity(modulus, ""):
        return _measured(name, rest)
    raise UsageError(f"{quoted(text)} lacks the unit or the standard uncertainty of the modulus; {EXAMPLE}")


def _is_quantity(text: str, unit: str) -> bool:
    try:
        parse(text, unit)
    except QuantityError:
        return False
    return True


def _stated(name: str, modulus: float, uncertainty: str) -> Reference:
    if not modulus > 0:
        raise RangeError(f"modulus {show(modulus, 'Pa')} of reference {name!r} is not above 0; give a positive one")
    share = parse(uncertainty, "", "2 %") if uncertainty.endswith("%") else parse(uncertainty, "Pa", "2 %") / modulus
    return Reference(name, modulus, share, sample=name if name in SAMPLES else "")


def _measured(name: str, text: str) -> Reference:
    """The tangent modulus of a compression test. Student's factor for its degrees of freedom widens its uncertainty."""
    run = Run.open(find_run(text, store()))
    if run.procedure != ModulusTest.name:
        raise UsageError(f"{run.folder}: is a run of {run.procedure}, which tells no modulus; {EXAMPLE}")
    if run.status != "complete":
        raise UsageError(f"{run.folder}: the run is {run.status}, not complete; resume it, or test the object anew")
    test, header = ModulusTest.recorded(run), run.header
    rows: list[Any] = [{k: v for k, v in row.items() if k not in ("id", "bench_ns")} for row in run.points()]
    points = values_of(DisplaysPoint, rows, f"{run.folder}: its points")
    given = header.get("calibration")
    try:
        calibration = check(given if isinstance(given, dict) else {}, LoadCellCalibration, str(run.folder))
    except ConfigError as error:
        raise RecordError(f"{error}; test the object anew") from None
    found = test.result_of(points, calibration).compression.tangent
    factor = coverage_factor(found.budget.degrees_of_freedom) / NORMAL_FACTOR
    u = factor * found.u / found.value
    return Reference(name, found.value, u, run.folder.name, run.digest(), test.sample, run.simulated, _scene(run))


def _scene(run: Run) -> str | None:
    """Identity of the scene that simulated the bench of a run; None: its bench was real, or nobody knows it."""
    with suppress(tomllib.TOMLDecodeError):
        scene = tomllib.loads(str(run.header["bench"])).get("scene")
        return scene if isinstance(scene, str) else None
    return None
