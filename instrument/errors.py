"""Every error that palpate raises on purpose.

    PalpateError
    ├── UsageError                   wrong or impossible arguments (exit status 2)
    │   ├── ConfigError              a bench, scene or calibration file is wrong
    │   ├── QuantityError            a text is not a quantity of the unit asked for   (ValueError)
    │   ├── RangeError               a value lies outside its limits                  (ValueError)
    │   └── UnknownName              no such sample, design, model, effect, scene     (LookupError)
    ├── BenchError                   the bench failed (exit status 1)
    │   ├── LinkError                a bus or connection failed                       (ConnectionError)
    │   │   └── LinkTimeout          no answer in time                                (TimeoutError)
    │   ├── DeviceError              a device answered with an error
    │   │   └── SettingsLost         the device no longer holds its settings
    │   ├── BenchInUse               another program has the bench or its amplifier
    │   ├── IdentityError            another device, version or word order than the contract's
    │   ├── SampleError              another sample is mounted than the procedure asked for
    │   ├── SafetyError              a limit of the bench was passed: outputs are off
    │   │   └── Unfed                the exciter has switched itself off, as it heard nothing of this program
    │   └── UnreachableError         the rig cannot reach what was asked for
    ├── EstimateError                a record does not determine the estimate         (ValueError)
    └── RecordError                  a run cannot be written or read                  (OSError)

Every message says what was wrong, the value, the limit and what to do.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")


class PalpateError(Exception):
    """The base of all errors that palpate raises on purpose; `exit_code` is the exit status of the command line."""

    exit_code = 1

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle it without its constructor, whose arguments may be others than the message."""
        return _remade, (type(self), self.args), self.__dict__


def _remade(kind: type[PalpateError], args: tuple[Any, ...]) -> PalpateError:
    error = kind.__new__(kind)
    error.args = args
    return error


class UsageError(PalpateError):
    exit_code = 2


class ConfigError(UsageError):
    pass


class QuantityError(UsageError, ValueError):
    pass


class RangeError(UsageError, ValueError):
    pass


LONGEST_QUOTED, MOST_QUOTED = 200, 5  # characters of a value in a message, and values of a list


def quoted(value: object) -> str:
    """A value for a message; of a long list its first values and their number, of a long text its beginning."""
    if isinstance(value, (tuple, list)) and len(value) > MOST_QUOTED:
        return f"{', '.join(quoted(each) for each in value[:MOST_QUOTED])}, ... ({len(value)} values)"
    text = repr(value)
    return text if len(text) <= LONGEST_QUOTED else f"{text[:LONGEST_QUOTED]}..."


def check_path(path: Path) -> None:
    """Raises UsageError: no file can have that name, because it holds a zero byte."""
    if "\0" in str(path):
        raise UsageError(f"{str(path)!r} holds a zero byte, which no file name can; give another name")


def reason(error: OSError) -> str:
    """What an error of the file system says, for people; "File exists" alone would not tell what stands in the way."""
    if isinstance(error, FileExistsError) and isinstance(error.filename, str):
        path = Path(error.filename)
        if path.is_symlink() and not path.exists():
            return f"{path} is a link to {path.readlink()}, which does not exist"
        if path.is_file():
            return f"{path} is a file, not a folder"
    return error.strerror or str(error)


MOST_LISTED = 60  # greatest number of names in a message; a store holds thousands of runs


class UnknownName(UsageError, LookupError):
    """A name does not exist. The message lists the valid names, or says `none`, and suggests the nearest."""

    def __init__(self, kind: str, name: object, valid: Iterable[str], none: str = "there is none yet") -> None:
        names = sorted(valid)
        more = [f"and {len(names) - MOST_LISTED} more"] if len(names) > MOST_LISTED else []
        shown = [quoted(each) if "," in each else each for each in names[:MOST_LISTED]]
        listed = f"valid: {', '.join(shown + more)}" if names else none
        super().__init__(f"unknown {kind} {quoted(str(name))}{nearest(str(name), names)}; {listed}")


def named(kind: str, name: str, among: Mapping[str, T]) -> T:
    """The entry with a name. Raises UnknownName: there is none."""
    if name not in among:
        raise UnknownName(kind, name, among)
    return among[name]


class BenchError(PalpateError):
    """The bench failed to do something.

    `device` is the name of the device that failed; empty: unknown. `code` is the code of a Modbus exception response;
    0: there was none.
    """

    def __init__(self, *args: object, device: str = "", code: int = 0) -> None:
        super().__init__(*args)
        self.device = device
        self.code = code


class LinkError(BenchError, ConnectionError):
    pass


class LinkTimeout(LinkError, TimeoutError):
    pass


class DeviceError(BenchError):
    pass


class SettingsLost(DeviceError):
    pass


class BenchInUse(BenchError):
    pass


class IdentityError(BenchError):
    pass


class SampleError(BenchError):
    pass


class SafetyError(BenchError):
    pass


class Unfed(SafetyError):
    """The exciter has switched itself off, as it heard nothing of this program: what has tripped, then a guess why."""

    def __str__(self) -> str:
        return ". ".join(map(str, self.args))


class UnreachableError(BenchError):
    pass


class EstimateError(PalpateError, ValueError):
    pass


class RecordError(PalpateError, OSError):
    pass


def nearest(name: str, valid: Iterable[str]) -> str:
    """`" (did you mean 'x'?)"` for the valid name that is most similar to `name`; empty if none is similar."""
    close = difflib.get_close_matches(name, list(valid), n=1, cutoff=0.6)
    return f" (did you mean {close[0]!r}?)" if close else ""
