"""Settings that several procedures have: what each means is said here, for scripts and for the command line."""

from __future__ import annotations

from typing import Annotated

from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import parse_tolerance
from palpate.procedures.engine.settings import Setting
from palpate.procedures.steps.checks import parse_bench_time

LONGEST_VALIDITY = 791  # days: 26 months, ISO 376

SampleName = Annotated[str, Setting(help="Rubber sample.")]
PeakLoad = Annotated[float, Setting("N", "Load, peak to peak.")]
PeakLoads = Annotated[tuple[float, ...], Setting("N", "Loads, peak to peak: first:last:step or a list.")]
LoadSets = Annotated[
    tuple[float, ...], Setting("N", "Loads, peak to peak: first:last:step or a list. A load may be repeated.")
]
DwellTime = Annotated[float, Setting("s", "Time over which each point is averaged.")]
Frequency = Annotated[float, Setting("Hz", "Frequency of the load.")]
Extrapolate = Annotated[bool, Setting(help="Allow loads outside the load cell's calibrated range.")]
ValidDays = Annotated[int, Setting(help="Days until the calibration expires.")]


def share_setting(text: str, determines: str = "") -> Setting:
    """A share, such as "5 %", that is above 0 and at most 0.5. `text` describes it; `determines` is as of `Setting`."""
    return Setting(help=text, read=parse_tolerance, metavar="SHARE", determines=determines)


def tolerance_setting(of: str, determines: str = "") -> Setting:
    """A tolerance, as a share. `of` says of what it is; `determines` is as of `Setting`."""
    return share_setting(f"Half-width of the 95 % interval, relative: {of}", determines)


def bench_time(text: str, determines: str = "") -> Setting:
    """A bench time [s]. `text` describes it; `determines` is as of `Setting`."""
    return Setting("s", text, parse_bench_time, determines=determines)


def model_name(text: str) -> Setting:
    """The name of a sensor model. `text` describes it."""
    return Setting(help=text, metavar="NAME")


def check_valid_days(days: int) -> None:
    """Refuse a validity of a calibration that is not from one day to the longest one. Raises RangeError."""
    if not 1 <= days <= LONGEST_VALIDITY:
        raise RangeError(f"validity of {days} days is outside 1 to {LONGEST_VALIDITY}; give one inside")
