"""Results for people: tables in the terminal and plots on disk, each saying where it is simulated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from instrument.design import Design
from instrument.quantity import show
from procedures.load_cell import LoadCellResult
from procedures.load_sweep import SweepResult
from procedures.run import Run, RunSummary, storing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.table import Table
    from rich.text import Text

    from instrument.models.price_list import PriceList
    from instrument.models.ratio import Answer
    from instrument.models.surface import ResponseSurface

STAMP = "SIMULATED"
PIPE_WIDTH = 160  # columns where no terminal says otherwise
MARKERS = "osD^vP*X"


def print_all(*things: object) -> None:
    """Texts as they are: what looks like markup is part of a name of a file or a message."""
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False, markup=False, emoji=False)
    if not console.is_terminal:
        console.width = PIPE_WIDTH
    for thing in things:
        console.print(thing, soft_wrap=not isinstance(thing, Table))


def new_table(title: Text | None, *columns: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", header_style="bold", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    return table


def stamped(simulated: bool, text: str) -> Text:
    from rich.text import Text

    return Text.assemble((f"{STAMP} " if simulated else "", "bold red"), text)


def print_sweep(result: SweepResult, design: Design, outcome: dict[str, Any], plot: Path) -> None:
    """Points, means beside the thesis' own, softness order, and where everything lies."""
    points = new_table(
        stamped(outcome["simulated"], "Load sets (forces and voltages peak to peak)"),
        "sample", "load\nN", "meter\nmV", "rigid\nmV", "total\nmV", "rigid\nN", "total\nN", "force\nratio", "u",
        "valid",
    )  # fmt: skip
    for p in result.points:
        points.add_row(
            p.sample, f"{p.load_N:g}", f"{p.indicator_mV:.1f}", f"{1e3 * p.voltage_rigid_V:.3f}",
            f"{1e3 * p.voltage_total_V:.2f}", f"{p.force_rigid_N:.3f}", f"{p.force_total_N:.3f}",
            f"{p.force_ratio:.4f}", f"{p.force_ratio_u:.4f}", "yes" if p.valid else "NO",
        )  # fmt: skip
    means = new_table(
        stamped(outcome["simulated"], "Mean force ratio"),
        "sample", "ours", "u", "thesis", "difference", "valid points",
    )  # fmt: skip
    for s in result.samples:
        if s.force_ratio is None or s.force_ratio_u is None:
            means.add_row(s.sample, "-", "-", _number(s.thesis_force_ratio), "-", "0")
            continue
        difference = (
            "-" if s.thesis_force_ratio is None else f"{100 * (s.force_ratio / s.thesis_force_ratio - 1):+.1f} %"
        )
        means.add_row(
            s.sample, f"{s.force_ratio:.4f}", f"{s.force_ratio_u:.4f}", _number(s.thesis_force_ratio), difference,
            str(s.valid_points),
        )  # fmt: skip
    swept = set(result.softness_order)
    thesis_order = [name for name in design.thesis_softness_order if name in swept]
    print_all(
        points,
        means,
        f"softness order, hard to soft: {' > '.join(result.softness_order)}   (thesis: {' > '.join(thesis_order)})",
        *_where(outcome, plot),
    )


def print_load_cell(result: LoadCellResult, outcome: dict[str, Any], plot: Path) -> None:
    """Readings, the line and its figures of merit."""
    readings = new_table(
        stamped(outcome["simulated"], "Load-cell calibration"), "load gf", "load N", "loading mV", "unloading mV"
    )
    up = [p for p in result.points if p["direction"] == "loading"]
    down = {p["load_gf"]: p for p in result.points if p["direction"] == "unloading"}
    for p in up:
        readings.add_row(
            f"{p['load_gf']:g}",
            f"{p['load_N']:.4f}",
            f"{p['reading_mV']:.2f}",
            f"{down[p['load_gf']]['reading_mV']:.2f}",
        )
    c = result.calibration
    print_all(
        readings,
        f"sensitivity    {c.sensitivity_mV_per_N:.3f} mV/N, u = {c.sensitivity_u:.3f} mV/N   (thesis: 10.3 mV/N)",
        f"zero           {c.zero_mV:.2f} mV, u = {c.zero_u:.2f} mV",
        f"linearity      {100 * c.linearity:.2f} % of the span",
        f"reversibility  {100 * c.reversibility:.2f} % of the span",
        f"resolution     {c.resolution_mV:g} mV = {show(c.resolution(), 'N')}",
        f"calibration    {outcome['calibration_file']}",
        *_where({**outcome, "calibration": None}, plot),
    )


def print_ratios(design: str, answers: list[Answer]) -> None:
    """A line a modulus."""
    models = ", ".join(dict.fromkeys(a.response.model for a in answers))
    table = new_table(
        stamped(False, f"{design}, model {models}"),
        "sensed modulus", "force ratio", "error estimate", "seconds",
    )  # fmt: skip
    for a in answers:
        given = a.response
        estimate = "-" if given.error_estimate is None else f"{given.error_estimate:.1e}"
        table.add_row(show(a.sensed_modulus, "Pa", 6), f"{given.force_ratio:.7g}", estimate, f"{a.seconds:.2g}")
    print_all(table, *dict.fromkeys(a.response.why for a in answers if a.response.why))


def print_moduli(design: str, points: list[dict[str, Any]]) -> None:
    """A line a force ratio."""
    models = ", ".join(dict.fromkeys(p["model"] for p in points))
    table = new_table(
        stamped(False, f"{design}, model {models}: Young modulus, 95 % interval"),
        "force ratio", "u", "modulus", "from", "to", "dlnE/dlnR", "",
    )  # fmt: skip
    for p in points:
        moduli = ["-" if p[name] is None else show(p[name], "Pa") for name in ("modulus_Pa", "low_Pa", "high_Pa")]
        table.add_row(
            f"{p['force_ratio']:g}", f"{p['force_ratio_u']:.2g}", *moduli, _number(p["sensitivity"]),
            ": ".join(text for text in (p["kind"], p["note"]) if text),
        )  # fmt: skip
    print_all(table)


def print_prices(prices: PriceList, designs: list[str], plot: Path | None) -> None:
    """A table a design: error and time of every model at every refinement."""
    low, high = (show(modulus, "Pa", 3) for modulus in prices.moduli_Pa[1:3])
    lowest, highest = (show(modulus, "Pa", 3) for modulus in (prices.moduli_Pa[0], prices.moduli_Pa[-1]))
    for design in designs:
        table = new_table(
            stamped(False, f"{design}: greatest error of the force ratio, and time of one answer in seconds"),
            "model", "refinement", f"{low} to\n{high}", f"{lowest} to\n{highest}", "build", "solve", "evaluate",
            "answer",
        )  # fmt: skip
        table.columns[1].justify = "left"
        failures = []
        for p in (price for price in prices.prices if price.design == design):
            everywhere = None if None in p.errors else max(error for error in p.errors if error is not None)
            times = [_short(value) for value in (p.build_s, p.solve_s, p.evaluate_s, p.answer_s)]
            table.add_row(p.model, p.refinement, _short(p.errors[1]), _short(everywhere), *times)
            if p.failure:
                failures.append(f"{p.model}, {p.refinement}: {p.failure}")
        how = [f"reference: {r.how}" for r in prices.references if r.design == design]
        print_all(table, *how, *failures, "")
    m = prices.machine
    print_all(f"measured on {m.cpu}, {m.cores} cores, {m.system}, Python {m.python}, {m.date}")
    if plot is not None:
        print_all(f"plot           {plot}")


def print_surfaces(surfaces: Mapping[str, ResponseSurface]) -> None:
    """A line a surface."""
    table = new_table(
        None, "design", "of model", "nodes", "modulus ratios", "relative error", "error of the model", "built in\ns"
    )
    for name, s in surfaces.items():
        table.add_row(
            name, s.model, str(len(s.coefficients)), f"{s.lowest:g} to {s.highest:g}", f"{s.error_bound:.1e}",
            f"{s.discretisation:.1e}", f"{s.seconds:.0f}",
        )  # fmt: skip
    print_all(table)


def print_runs(found: list[RunSummary], folder: Path) -> None:
    """A line a run."""
    if not found:
        print_all(f"no runs in {folder}; make one with: palpate sweep loads")
        return
    table = new_table(None, "run", "status", "points", "")
    for run in found:
        table.add_row(run.folder.name, run.status, str(run.points), STAMP if run.simulated else "")
    print_all(f"Runs in {folder}", table, *(f"damaged: {run.fault}" for run in found if run.fault))


def run_row(run: RunSummary) -> dict[str, Any]:
    """A run in a JSON list."""
    return {
        "run": str(run.folder.absolute()),
        "started": run.started.isoformat(),
        "procedure": run.procedure,
        "simulated": run.simulated,
        "status": run.status,
        "points": run.points,
        "fault": run.fault or None,
    }


def run_object(run: Run, digest: str) -> dict[str, Any]:
    """A whole run as JSON."""
    return {
        "run": str(run.folder),
        "procedure": run.procedure,
        "simulated": run.simulated,
        "status": run.status,
        "digest": digest,
        "header": dict(run.header),
        "summary": dict(run.summary),
        "points": run.points(),
        "events": run.events(),
    }


def print_run(run: Run, digest: str) -> None:
    """Header, points and events of a run."""
    calibration: Any = run.header.get("calibration") or {}
    points = run.points()
    columns = [k for k, v in points[0].items() if k != "bench_ns" and not isinstance(v, list)] if points else []
    table = new_table(stamped(run.simulated, f"{run.procedure}: {len(points)} points"), *columns)
    for point in points:
        table.add_row(*(_number(point[column]) for column in columns))
    print_all(
        stamped(run.simulated, str(run.folder)),
        f"status       {run.status}",
        f"started      {run.started:%Y-%m-%d %H:%M:%S} UTC",
        f"seed         {run.header.get('seed')}",
        f"calibration  {calibration.get('source', '-')}",
        f"digest       {digest}",
        table,
        *(f"event at {event['bench_ns'] / 1e9:.1f} s: {event['kind']}: {event['message']}" for event in run.events()),
    )


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.1e}"


def _number(value: object) -> str:
    return "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _where(outcome: dict[str, Any], plot: Path) -> list[str]:
    lines = [f"calibration    {outcome['calibration']}"] if outcome["calibration"] else []
    bench, wall = outcome["bench_seconds"], outcome["wall_seconds"]
    return [
        *lines,
        f"time           {bench:.0f} s on the bench, {wall:.1f} s here (x {bench / wall:.0f})",
        f"run            {outcome['run']}",
        f"plot           {plot}",
    ]


def _figure(simulated: bool, panels: int) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.2 * panels, 4.2), layout="constrained")
    axes = [figure.add_subplot(1, panels, i + 1) for i in range(panels)]
    for ax in axes:
        ax.grid(alpha=0.3)
        if simulated:
            ax.text(
                0.5, 0.5, STAMP, transform=ax.transAxes, fontsize=34, color="red", alpha=0.12, rotation=25,
                ha="center", va="center", zorder=0,
            )  # fmt: skip
    return figure, axes


def _save(figure: Figure, folder: Path) -> Path:
    path = folder / "plot.png"
    with storing(path):
        figure.savefig(path, dpi=120, metadata={"Software": None})
    return path


def plot_sweep(result: SweepResult, design: Design, simulated: bool, folder: Path) -> Path:
    """Force ratio against load for each sample, and the means beside the thesis' own; returns the PNG."""
    figure, (left, right) = _figure(simulated, 2)
    figure.suptitle(f"{STAMP + ': ' if simulated else ''}force ratio, design {design.name}")
    for number, mean in enumerate(result.samples):
        points = [p for p in result.points if p.sample == mean.sample]
        left.errorbar(
            [p.load_N for p in points], [p.force_ratio for p in points], [p.force_ratio_u for p in points],
            marker=MARKERS[number % len(MARKERS)], ms=4, lw=1, capsize=2, label=f"sample {mean.sample}",
        )  # fmt: skip
    if invalid := [p for p in result.points if not p.valid]:
        left.plot([p.load_N for p in invalid], [p.force_ratio for p in invalid], "rx", ms=10, label="not valid")
    left.set(xlabel="load, peak to peak (N)", ylabel="force ratio (bars: standard uncertainty)", ylim=(0, None))
    left.legend(fontsize=8, ncols=2)
    shown = [s for s in result.samples if s.valid_points]
    place = range(len(shown))
    ratio, ratio_u, thesis = (
        [math.nan if value is None else value for value in values]
        for values in (
            [s.force_ratio for s in shown],
            [s.force_ratio_u for s in shown],
            [s.thesis_force_ratio for s in shown],
        )
    )
    right.errorbar(place, ratio, ratio_u, fmt="o", capsize=3, label="this run")
    right.plot(place, thesis, "k_", ms=16, label="thesis, Tables A2.9-A2.14")
    right.set(xlabel="sample", ylabel="mean force ratio", ylim=(0, None))
    right.set_xticks(list(place), [s.sample for s in shown])
    right.legend(fontsize=8)
    return _save(figure, folder)


def plot_load_cell(result: LoadCellResult, simulated: bool, folder: Path) -> Path:
    """Readings with the line, and their deviation from it; returns the PNG."""
    figure, (left, right) = _figure(simulated, 2)
    figure.suptitle(f"{STAMP + ': ' if simulated else ''}load-cell calibration")
    c = result.calibration
    for direction, marker in (("loading", "^"), ("unloading", "v")):
        load = [p["load_N"] for p in result.points if p["direction"] == direction]
        reading = [p["reading_mV"] for p in result.points if p["direction"] == direction]
        left.plot(load, reading, marker, label=direction)
        right.plot(load, [y - c.reading(x) for x, y in zip(load, reading, strict=True)], marker, label=direction)
    ends = [0.0, max(p["load_N"] for p in result.points)]
    left.plot(ends, [c.reading(x) for x in ends], "k-", lw=1, label=f"{c.sensitivity_mV_per_N:.3f} mV/N")
    left.set(xlabel="load (N)", ylabel="reading (mV)")
    right.axhline(0, color="k", lw=1)
    right.set(xlabel="load (N)", ylabel="deviation from the line (mV)")
    left.legend(fontsize=8)
    right.legend(fontsize=8)
    return _save(figure, folder)
