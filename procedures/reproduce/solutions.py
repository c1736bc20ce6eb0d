"""Kept finite-element solutions for reproducing the thesis: they take more than a minute and are always the same.

Each is kept under a hash of every number on which it depends and of the version of the models' code. So a changed
design or model does not find it and is solved anew. `palpate reproduce models --fresh` solves everything and writes the
content of `solutions.json`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

from palpate.instrument.errors import ConfigError
from palpate.instrument.models.parameters import CODE_VERSION, RoundParameters, SolidParameters
from palpate.procedures.records.run import storing

SHIPPED = Path(__file__).with_name("solutions.json")
DIGITS = 10  # of a modulus: nodes differ by rounding from machine to machine


@dataclass(slots=True)
class Solutions:
    """Known solutions, and the solutions that were asked for so far."""

    known: dict[str, list[float]] = field(default_factory=dict)
    asked: dict[str, list[float]] = field(default_factory=dict)

    @classmethod
    def shipped(cls, file: Path = SHIPPED) -> Self:
        """Solutions that come with palpate. Raises ConfigError: the file is damaged."""
        try:
            known = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
            if all(isinstance(number, float) for numbers in known.values() for number in numbers):
                return cls(known)
        except (OSError, ValueError, AttributeError, TypeError, RecursionError):
            pass
        raise ConfigError(f"{file}: is damaged; solve anew: palpate reproduce models --fresh")

    def of(
        self,
        parameters: RoundParameters | SolidParameters,
        what: str,
        solve: Callable[[], Sequence[float]],
    ) -> list[float]:
        """Kept numbers for these parameters, else the result of `solve`; `what` names mesh and quantity."""
        modulus = float(f"{parameters.sensed_modulus:.{DIGITS}g}")
        rounded = replace(parameters, sensed_modulus=modulus).canonical()
        text = f"{CODE_VERSION};{type(parameters).__name__};{what};{rounded}"
        key = hashlib.sha256(text.encode()).hexdigest()[:32]
        self.asked[key] = self.known[key] if key in self.known else list(solve())
        return self.asked[key]

    def write(self, folder: Path) -> Path:
        """Write all solutions that were asked for, as a file to ship. Raises RecordError."""
        path = folder / SHIPPED.name
        with storing(path):
            path.write_text(self.text(), encoding="utf-8")
        return path

    def text(self) -> str:
        """Text of the file with all solutions that were asked for."""
        return json.dumps(self.asked, indent=0, sort_keys=True) + "\n"
