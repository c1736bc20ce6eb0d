"""Shows and plots the result of a load sweep."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.models.evidence import Evidence
from palpate.instrument.quantity import plus_minus
from palpate.instrument.sensor.design import Design
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.loads.result import LoadPoint, SampleMean, SweepResult
from palpate.procedures.records.columns import Column, columns_of
from palpate.procedures.showing.figure import name_all, new_figure, plot_over_loads, save, with_u
from palpate.procedures.showing.tables import NOTHING, table_of
from palpate.procedures.showing.text import legend, new_table, percent, stamped

ROUNDING = 1e-6  # of a tolerance
OF_CHOSEN = ("dwell_s", "relative_u_predicted", "relative_u")  # columns of points whose dwell was chosen

if TYPE_CHECKING:
    from rich.table import Table


def show_sweep(result: SweepResult, design: Design, outcome: Outcome) -> list[object]:
    """The points, the means beside the thesis' means, and the softness order."""
    columns = columns_of(LoadPoint)
    if all(p.relative_u_predicted is None for p in result.points):
        columns = {name: column for name, column in columns.items() if name not in OF_CHOSEN}
    title = "Load sets (forces and voltages peak to peak)"
    points = table_of(stamped(outcome["simulated"], title), result.points, columns)
    worth = outcome["evidence"] if design.thesis_force_ratio else None
    columns = columns_of(SampleMean) | {"difference": Column(head="difference", cell=_difference)}
    if worth:
        columns["evidence"] = Column(head="evidence", cell=partial(_evidence, worth))
    means = table_of(stamped(outcome["simulated"], "Mean force ratio"), result.samples, columns)
    compared = f"   (thesis: {said})" if (said := _thesis_order(design, set(result.softness_order))) else ""
    repeated = sum(p.attempts - 1 for p in result.points)
    return [
        points,
        *([_teeth(result, outcome["simulated"])] if any(s.teeth for s in result.samples) else []),
        means,
        *([_worth(worth, outcome["model"])] if worth else []),
        f"softness order, hard to soft: {' > '.join(result.softness_order) or 'none, no point is valid'}{compared}",
        *legend(points, means),
        *([] if result.tolerance is None else [_tolerance(result.tolerance, result)]),
        _forces(result.points),
        *([f"repeated       {repeated} attempts were rejected; events of the run say why"] if repeated else []),
    ]


def _difference(mean: SampleMean) -> str:
    """The mean over the thesis' mean, less one."""
    if mean.force_ratio is None or mean.thesis_force_ratio is None:
        return NOTHING
    return f"{100 * (mean.force_ratio / mean.thesis_force_ratio - 1):+z.1f} %"


def _evidence(worth: str, mean: SampleMean) -> str:
    """What agreement of a mean with the thesis is worth."""
    return NOTHING if mean.force_ratio is None else worth


def _tolerance(tolerance: float, result: SweepResult) -> str:
    """A line that says of what the tolerance is, and what was reached."""
    of = "the mean of each sample" if result.tolerance_for == "mean" else "each point"
    half = result.reached
    reached = f"{plus_minus(half, 3)} reached at most" if half is not None else "not known what was reached"
    missed = ", NOT REACHED" if half is not None and half > tolerance * (1 + ROUNDING) else ""
    return f"tolerance      {plus_minus(tolerance, 3)} of {of}: {reached}{missed}"


def _worth(evidence: str, model: str | None) -> str:
    """A line that says what agreement with the thesis' means is worth. The scene's model may contain those means."""
    if evidence == Evidence.INPUT.value:
        return f"{evidence}: model {model} is the thesis' own means; agreement shows that the bench measures right"
    return f"{evidence}: model {model} knows nothing of the thesis' means"


def _forces(points: Sequence[LoadPoint]) -> str:
    """A line with the largest relative uncertainties of the forces. They hardly differ."""
    rigid, total = (
        max((u / abs(force) for force, u in pairs if u is not None and force), default=None)
        for pairs in (
            [(p.force_rigid_N, p.force_rigid_u) for p in points if p.valid],
            [(p.force_total_N, p.force_total_u) for p in points if p.valid],
        )
    )
    return f"forces         standard uncertainty, % at most: rigid {percent(rigid)}, total {percent(total)}"


def _thesis_order(design: Design, swept: set[str]) -> str:
    """The softness order of the thesis by its means, and that of its figure at 3 N if it differs."""
    means = sorted(design.thesis_force_ratio, key=lambda name: design.thesis_force_ratio[name], reverse=True)
    by_mean, figure = (
        " > ".join(name for name in order if name in swept) for order in (means, design.thesis_softness_order)
    )
    return by_mean if by_mean == figure else f"{by_mean}; its figure at 3 N: {figure}"


def _teeth(result: SweepResult, simulated: bool) -> Table:
    """A table of the mean ratio of each tooth, with a row for each sample."""
    count = max(len(s.teeth) for s in result.samples)
    teeth = new_table(
        stamped(simulated, "Mean force ratio of each tooth to its base"), "sample", *(str(i + 1) for i in range(count))
    )
    for s in result.samples:
        teeth.add_row(s.sample, *(f"{tooth:z.4f}" for tooth in s.teeth))
    return teeth


def plot_sweep(result: SweepResult, design: Design, simulated: bool, folder: Path) -> Path:
    """Plot force ratios over loads, and the means beside the thesis' means. Returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"force ratio, design {design.name}")
    for which, mean in enumerate(result.samples):
        points = [p for p in result.points if p.sample == mean.sample]
        plot_over_loads(left, which, f"sample {mean.sample}", points)
    if invalid := [p for p in result.points if not p.valid]:
        left.plot([p.load_N for p in invalid], [p.force_ratio for p in invalid], "rx", ms=10, label="not valid")
    left.set(xlabel="load, peak to peak (N)", ylabel="force ratio (bars: standard uncertainty)", ylim=(0, None))
    name_all(left, 4)
    shown = [s for s in result.samples if s.valid_points]
    place = range(len(shown))
    right.errorbar(place, *with_u(shown, "force_ratio"), fmt="o", capsize=3, label="this run")
    if design.thesis_force_ratio:
        right.plot(place, with_u(shown, "thesis_force_ratio")[0], "k_", ms=16, label="thesis, mean of its tables")
    right.set(xlabel="sample", ylabel="mean force ratio (bars: u)", ylim=(0, None))
    right.set_xticks(list(place), [s.sample for s in shown])
    name_all(right)
    return save(figure, folder)
