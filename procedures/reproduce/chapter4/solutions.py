"""Finite-element solutions that reproducing the thesis takes, kept: they are a minute and more, and always the same.

Each is kept under a hash of every number that it depends on and of the version of the models' code, so that a changed
design or model misses it and is solved anew. `palpate reproduce models --fresh` solves all, and writes what
`solutions.json` here holds.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

from palpate.instrument.errors import ConfigError
from palpate.instrument.models.parameters import RoundParameters, SolidParameters
from palpate.instrument.models.stored.surface import CODE_VERSION
from palpate.procedures.records.run import storing

SHIPPED = Path(__file__).with_name("solutions.json")
DIGITS = 10  # of a modulus: nodes are the same on every machine but for rounding


@dataclass(slots=True)
class Solutions:
    """What is known, and what was asked for so far."""

    known: dict[str, list[float]] = field(default_factory=dict)
    asked: dict[str, list[float]] = field(default_factory=dict)

    @classmethod
    def shipped(cls, file: Path = SHIPPED, renew: str = "palpate reproduce models --fresh") -> Self:
        """Those that come with palpate, in a file that the command `renew` writes. Raises ConfigError."""
        try:
            known = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
            if all(isinstance(number, float) for numbers in known.values() for number in numbers):
                return cls(known)
        except (OSError, ValueError, AttributeError, TypeError, RecursionError):
            pass
        raise ConfigError(f"{file}: is damaged; solve anew: {renew}")

    def of(
        self,
        parameters: RoundParameters | SolidParameters,
        what: str,
        solve: Callable[[], Sequence[float]],
    ) -> list[float]:
        """The kept numbers for these parameters, or what `solve` gives; `what` names mesh and quantity."""
        modulus = float(f"{parameters.sensed_modulus:.{DIGITS}g}")
        rounded = replace(parameters, sensed_modulus=modulus).canonical()
        text = f"{CODE_VERSION};{type(parameters).__name__};{what};{rounded}"
        key = hashlib.sha256(text.encode()).hexdigest()[:32]
        self.asked[key] = self.known[key] if key in self.known else list(solve())
        return self.asked[key]

    def write(self, folder: Path) -> Path:
        """All that were asked for, as a file to ship. Raises RecordError."""
        path = folder / SHIPPED.name
        with storing(path):
            path.write_text(self.text(), encoding="utf-8")
        return path

    def text(self) -> str:
        """All that were asked for, as the file has them."""
        return json.dumps(self.asked, indent=0, sort_keys=True) + "\n"
