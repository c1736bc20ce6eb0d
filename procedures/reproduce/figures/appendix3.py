"""Figure A3.5: what the bridge of the strain indicator gives. The thesis prints its equations and no numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.instrument.calibration.bridge import Bridge
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.procedures.reproduce.figures.picture import SavedPicture, canvas, legend, save

BRIDGE = "Figure A3.5"


def draw_bridge(folder: Path) -> SavedPicture:
    """Draw the output over one arm and over the strain of one gage or four. Raises RecordError."""
    figure, (arm, gages) = canvas(BRIDGE, 2)
    ratios, strains, factor = np.linspace(0.02, 3, 150), np.linspace(-2e-3, 2e-3, 81), THESIS_LOAD_CELL.gage_factor
    arm.plot(ratios, [Bridge(ratio, 1, 1, 1).output for ratio in ratios], color="C0", label="R2 = R3 = R4")
    arm.plot([Bridge(1, 1, 1, 1).balancing_r1], [0], "o", color="C3", label="balance, R1 R3 = R2 R4")
    arm.set(xlabel="R1 / R2", ylabel="e / E")
    one = [1e3 * Bridge.of_gages(factor, strain, 0, 0, 0).output for strain in strains]
    four = [1e3 * Bridge.of_gages(factor, strain, -strain, strain, -strain).output for strain in strains]
    gages.plot(1e6 * strains, one, color="C1", label="one gage")
    gages.plot(1e6 * strains, four, color="C2", label="four gages, as in 5.2")
    gages.set(xlabel="strain [µm/m]", ylabel="e / E [mV/V]")
    legend(figure)
    caption = (
        "Computed by equations A3.1 to A3.3, whose indices are not readable; the thesis prints no numbers, so that"
        f" nothing is compared. Right: at the gage factor of {factor:g} from 5.2. The output of one gage is at most"
        f" {100 * (1 - 4 * one[-1] / four[-1]):.2f} % off a straight line when stretched; of four it is straight."
    )
    return save(figure, BRIDGE, caption, folder)
