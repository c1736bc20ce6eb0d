"""A class of ISO 376 that is asked of a calibration: what runs and loads it needs, and what no run can mend."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.instrument.calibration.classification import ISO_376, ISO_376_LOADS, ISO_376_PART
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.quantity import show

RUNS, POSITIONS = 2, (0.0, 120.0, 240.0)  # of ISO 376: repeatability needs two runs, reproducibility several positions


def check_class(
    name: str, loads: Sequence[float], runs: int, positions: Sequence[float], cell: LoadCellCalibration
) -> None:
    """Refuse a class that these runs and loads cannot give, whatever is read, before anything moves.

    Args:
        name: name of the class.
        loads: increasing loads [N].
        runs: runs up and down in each position.
        positions: positions of the cell about its axis [degrees].
        cell: what is known of the cell: sensitivity, and the indicator's step.

    Raises:
        UnknownName: there is no such class.
        RangeError: the standard asks for more loads, runs or positions, or the indicator's step binds; the message
            names the best class, and what would do.
    """
    if name not in ISO_376:
        raise UnknownName("class of ISO 376", name, list(ISO_376))
    lacking = [
        f"{ISO_376_LOADS} loads, not {len(loads)}" if len(loads) < ISO_376_LOADS else "",
        f"a load of {ISO_376_PART:.0%} of the greatest or less" if loads[0] > ISO_376_PART * loads[-1] else "",
        f"{RUNS} runs in a position, not {runs}" if runs < RUNS else "",
        f"{len(POSITIONS)} positions, not {len(positions)}" if len(positions) < len(POSITIONS) else "",
    ]
    if any(lacking):
        raise RangeError(
            f"--class {name}: ISO 376 asks for {'; '.join(filter(None, lacking))}: give for example --loads "
            f"'300 gf:1000 gf:100 gf' --runs {RUNS} --positions 0,120,240"
        )
    half = max(load for load in loads if load <= ISO_376_PART * loads[-1])  # a class holds from here at the latest
    step = cell.resolution() / half
    if step <= ISO_376[name]["resolution"]:
        return
    best = next((each for each, limits in ISO_376.items() if step <= limits["resolution"]), None)
    needed_mV = ISO_376[name]["resolution"] * half * cell.sensitivity_mV_per_N
    needed_N = cell.resolution() / ISO_376[name]["resolution"] / ISO_376_PART
    limit = ISO_376[name]["resolution"]
    lines = [
        f"--class {name} cannot be reached: resolution binds: a step of the indicator,"
        f" {show(cell.resolution_mV, 'mV')}, is {100 * step:.3g} % of {show(half, 'N')}, above the"
        f" {100 * limit:.3g} % of that class; no number of runs lowers it",
        f"best now  {'no class' if best is None else f'--class {best}'}",
        f"or        an indicator with steps of {needed_mV:.2g} mV or less",
        f"or        loads up to {show(needed_N, 'N')} or more, if the cell takes them",
    ]
    raise RangeError("\n  ".join(lines))
