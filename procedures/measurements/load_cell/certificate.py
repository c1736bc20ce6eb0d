"""Writes the certificate of a load-cell calibration, as Markdown, HTML and DCC, from the finished run on disk."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.instrument.bench.description import recorded_bench
from palpate.instrument.calibration.load_cell import (
    STANDARD_GRAVITY,
    Classification,
    LoadCellCalibration,
    iso_376_class_of,
    load_budget,
)
from palpate.instrument.durable import put_whole
from palpate.instrument.uncertainty.budget import COVERAGE, coverage_factor
from palpate.procedures.measurements.load_cell.dcc import IN_WORDS, CertifiedQuantity, dcc
from palpate.procedures.measurements.load_cell.report import CREEP_TIMES, FILTER, SETTLING, ZERO_AFTER
from palpate.procedures.records.run import Run, storing
from palpate.procedures.showing.page import page, pairs, rows, section
from palpate.procedures.showing.text import STAMP
from palpate.procedures.steps.beside import sentence, summed_up

TITLE = "Calibration certificate of a load cell"

PLACED = {"simulated": "placed by the simulated operator", "confirmed": "each confirmed by name"}


@dataclass(frozen=True, slots=True)
class CertificateSection:
    """A heading and a table below it."""

    heading: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[str]]


def write_certificate(folder: Path, calibration: LoadCellCalibration) -> Path:
    """Write `certificate.md`, `.html` and `.xml` into the folder of a run; returns the Markdown file.

    Raises:
        RecordError: the run cannot be read, or the files cannot be written.
    """
    run, quantities = Run.open(folder), _quantities(calibration)
    sections = _sections(run, calibration, quantities)
    by_section = {each.heading: list(map(_name_and_text, each.rows)) for each in sections if each.heading in IN_WORDS}
    texts = {
        "certificate.md": _markdown(calibration.simulated, sections),
        "certificate.html": page(TITLE, calibration.simulated, map(_html, sections)),
        "certificate.xml": dcc(run, calibration.device, quantities, by_section),
    }
    for name, text in texts.items():
        with storing(folder / name):
            put_whole(folder / name, text)
    return folder / "certificate.md"


def _sections(run: Run, c: LoadCellCalibration, quantities: Sequence[CertifiedQuantity]) -> list[CertificateSection]:
    header: dict[str, Any] = dict(run.header)
    settings = header["settings"]
    bench = recorded_bench(header["bench"], f"{run.folder}: its bench file")
    settings_of = bench.filling("load_indicator")[0].settings
    indicator = settings_of.model_dump(mode="json", exclude={"gage_factor"}, exclude_none=True)
    points = run.points()
    runs = {p["position_deg"]: p["run"] for p in points if p["direction"] == ZERO_AFTER}  # the last one of each
    loads_u = settings["loads_u"]
    pair = ("", "")
    return [
        CertificateSection("Identities", pair, [
            ("load cell with indicator", c.device),
            ("bench", bench.name),
            *((name, serial or "unknown") for name, serial in header["devices"].items()),
            *run.about.items(),
            ("record", run.folder.name),
            ("software", f"palpate {header['versions']['palpate']}, commit {header['commit'] or 'unknown'}"),
        ]),
        CertificateSection("Settings", pair, [
            ("gage factor", f"{c.gage_factor:g}"),
            *((f"indicator: {name.replace('_', ' ')}", str(value)) for name, value in indicator.items()),
            ("filter, waiting time before a reading", f"{FILTER:g} s, {SETTLING:g} s"),
            ("readings averaged for a point", f"{settings['repeats']}"),
            ("runs up and down in each position", ", ".join(map(str, runs.values()))),
            ("positions", ", ".join(f"{place:g}°" for place in runs)),
            ("curve", f"degree {2 if c.curvature else 1}, {'asked for' if settings['degree'] else 'by F-test'}"),
        ]),
        CertificateSection("Conditions", pair, [
            ("begun", header["started"]),
            ("time on the bench", f"{points[-1]['bench_ns'] * 1e-9:.0f} s"),
            ("loads", f"dead weights at {STANDARD_GRAVITY} m/s², {c.least_N:.4g} to {c.greatest_N:.4g} N"),
            ("uncertainty of all loads together", f"{100 * loads_u:g} %" if loads_u else "none given"),
            ("weights and positions", PLACED.get(str(header.get("mounting")), "ASSUMED, nobody confirmed them")),
            *(
                [(each["name"].replace("_", " "), sentence(each)) for each in summed_up(bench.beside, points)]
                or [("temperature, humidity", "not recorded")]
            ),
        ]),
        _results(quantities),
        _classes(c),
        CertificateSection("Raw readings", ("position", "run", "what", "load gf", "load N", "mean mV", "readings mV"), [
            (
                f"{p['position_deg']:g}°", f"{p['run']}", p["direction"].replace("_", " "), f"{p['load_gf']:g}",
                f"{p['load_N']:.5f}", f"{p['reading_mV']:.4f}", " ".join(f"{v:g}" for v in p["readings_mV"]),
            )
            for p in points
        ]),
        CertificateSection("Validity", pair, [
            ("calibrated", c.created),
            ("expires", c.expires or "no date given"),
            ("valid for", f"{c.least_N:.4g} to {c.greatest_N:.4g} N with this indicator at this gage factor"),
        ]),
    ]  # fmt: skip


def _name_and_text(row: Sequence[str]) -> tuple[str, str]:
    """A row of two or three cells in words: a name, then a value and its class, if they are known."""
    name, *cells = row
    return name, "; class: ".join(cell for cell in cells if cell != "-")


def _quantities(c: LoadCellCalibration) -> list[CertifiedQuantity]:
    """The curve, and a load at three readings, with their uncertainties."""
    k = coverage_factor(math.inf if c.degrees_of_freedom is None else float(c.degrees_of_freedom))
    found = [
        CertifiedQuantity("sensitivity", c.sensitivity_mV_per_N, c.sensitivity_u, k, "mV/N"),
        CertifiedQuantity("zero", c.zero_mV, c.zero_u, k, "mV"),
        *([CertifiedQuantity("curvature", c.curvature.mV_per_N2, c.curvature.u, k, "mV/N²")] if c.curvature else []),
    ]
    for load in (c.least_N, 0.5 * (c.least_N + c.greatest_N), c.greatest_N):
        budget = load_budget(c, load)
        name = f"load at one reading of {c.reading(load):.2f} mV"
        found.append(CertifiedQuantity(name, load, budget.u, coverage_factor(budget.degrees_of_freedom), "N"))
    return found


def _results(quantities: Sequence[CertifiedQuantity]) -> CertificateSection:
    rows = [
        (each.name, f"{each.value:.5g}", f"{each.u:.2g}", f"{each.k:.2f}", f"{each.expanded:.2g}", each.unit)
        for each in quantities
    ]
    columns = ("quantity", "value", "standard uncertainty", "k", f"expanded uncertainty, {COVERAGE:.0%}", "unit")
    return CertificateSection("Results", columns, rows)


def _classes(c: LoadCellCalibration) -> CertificateSection:
    rows = [
        (
            f"{name}",
            *(("not measured", "-") if value is None else (f"{100 * value:.3g} %", iso_376_class_of(key, value))),
        )
        for name, key, value in (
            ("repeatability b'", "repeatability", c.repeatability),
            ("reproducibility b", "reproducibility", c.reproducibility),
            ("interpolation error fc", "interpolation", c.interpolation),
            ("zero return f0", "zero_return", c.zero_return),
            (f"creep c, {CREEP_TIMES[0]:g} to {CREEP_TIMES[1]:g} s", "creep", c.creep),
            ("reversibility v", "reversibility", c.reversibility_of_reading),
            ("resolution at the least load", "resolution", c.resolution() / c.least_N),
        )
    ]
    return CertificateSection("Classification", ("quantity", "value", "class"), [
        *rows,
        ("linearity, of the span", f"{100 * c.linearity:.3g} %", "-"),
        ("ISO 376", _held(c.iso_376), c.iso_376.name),
        ("lower limit factor of ASTM E74", f"{c.lower_limit_factor_N:.3g} N", "-"),
        ("ASTM E74", _held(c.astm_e74), c.astm_e74.name),
    ])  # fmt: skip


def _held(found: Classification) -> str:
    return found.reason or f"{found.least_N:.4g} to {found.greatest_N:.4g} N"


def _markdown(simulated: bool, sections: Sequence[CertificateSection]) -> str:
    lines = [f"# {STAMP + ': ' if simulated else ''}{TITLE}", ""]
    for each in sections:
        lines += [f"## {each.heading}", "", _row(each.columns), _row(["---"] * len(each.columns))]
        lines += [*(_row(row) for row in each.rows), ""]
    return "\n".join(lines)


def _row(cells: Sequence[str]) -> str:
    safe = (" ".join(html.escape(cell, quote=False).split()).replace("|", "&#124;") for cell in cells)
    return f"| {' | '.join(safe)} |"


def _html(of: CertificateSection) -> str:
    return section(of.heading, [rows(of.columns, of.rows) if any(of.columns) else pairs((a, b) for a, b in of.rows)])
