"""Curves of a figure: a sensor by a theory on a ring, by the thesis and by us."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.evidence import Evidence, of_model, ratio_by
from palpate.instrument.thesis import read_table
from palpate.procedures.reproduce.chapter4.theory import OF_THEORY, beam_ratios, implied, sample_moduli
from palpate.procedures.reproduce.curves import RING, STIFF_RING, Case, Curves

Array = NDArray[np.float64]

MODULI = np.geomspace(14.9e3, 140e6, 60)  # Table A2.1 without its last row, 140 GPa
BEAM_SET = "physical"  # the only set of the beam
# Tables of each design's force ratio at all moduli, by ring.
TABLES = {
    "single": {RING: "A2.1", STIFF_RING: "A2.2"},
    "common_base": {RING: "A2.3", STIFF_RING: "A2.4"},
    "different_base": {RING: "A2.5", STIFF_RING: "A2.6"},
}


@dataclass(frozen=True, slots=True)
class Line:
    """A curve of a figure: the sensor, also in words, our model, and the modulus of the ring [Pa]."""

    words: str
    design: str
    model: str
    ring: float = RING

    @property
    def label(self) -> str:
        return f"{self.words}, ring {self.ring / 1e3:.0f} kPa"

    @property
    def source(self) -> str:
        """Table in which the thesis prints the values; empty: none."""
        if self.model != "beam":
            return f"Table {TABLES[self.design][self.ring]}"
        return "rebuilt from Table 5.8" if self.ring == RING else ""

    def sets(self, parameters: tuple[str, ...]) -> tuple[str, ...]:
        """The parameter sets among these that the model has."""
        return parameters if self.model != "beam" else tuple(name for name in parameters if name == BEAM_SET)

    def case(self, parameters: str) -> Case:
        return Case(self.design, self.model, parameters, self.ring)

    def ours(self, parameters: str, moduli: Array, curves: Curves) -> Array:
        """Our force ratios at moduli of the object [Pa]."""
        if self.model == "beam":
            return np.array(_beam(tuple(moduli.tolist()), self.ring))
        return curves.of(self.case(parameters)).force_ratio(moduli)

    def thesis(self) -> tuple[Array, Array]:
        """The thesis' moduli [Pa], without 140 GPa, and force ratios; empty where it prints none."""
        if not self.source:
            return np.array([]), np.array([])
        if self.model == "beam":
            order = np.argsort(sample_moduli())
            return sample_moduli()[order], implied("single_vs_2D")[OF_THEORY][order]
        table = read_table(TABLES[self.design][self.ring])
        ratio = table.values("force_ratio" if "force_ratio" in table.columns else "force_rigid_N")
        inside = table.keys() <= MODULI[-1]
        return table.keys()[inside], abs(ratio[inside])

    def evidence(self, parameters: str, *tables: str) -> Evidence:
        """Evidence of our curve by a parameter set, beside tables of the thesis; by default those of `thesis`."""
        own = () if not self.source else ("5.8",) if self.model == "beam" else (TABLES[self.design][self.ring],)
        return of_model("force_ratio", ratio_by(self.model, parameters), *(tables or own))

    def by(self, parameters: str) -> str:
        """Label of our curve."""
        return "beam" if self.model == "beam" else f"{parameters} set"


@cache
def _beam(moduli: tuple[float, ...], ring: float) -> tuple[float, ...]:
    return tuple(beam_ratios(np.array(moduli), ring).tolist())
