"""The report of a run as a page, or of several runs of one procedure, which are compared."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.instrument.durable import numbered, put_whole
from palpate.instrument.errors import PalpateError, UsageError
from palpate.instrument.quantity import show, show_with_u
from palpate.procedures.console.terminal import load_matplotlib
from palpate.procedures.engine.catalogue import procedure_class
from palpate.procedures.engine.difference import (
    BY_CHANCE,
    FAR,
    GREATEST,
    ComparedPoints,
    Difference,
    PointDifference,
    check_alike,
    compared_points,
    differences,
)
from palpate.procedures.engine.replay import RecordedResult, result_of
from palpate.procedures.engine.settings import asked_of, shown
from palpate.procedures.engine.verdict import Judgement, LimitsFile, judge, number_columns
from palpate.procedures.records.damage import check, repair
from palpate.procedures.records.run import Run, check_new, storing, telling_damage
from palpate.procedures.showing.budget import show_budgets
from palpate.procedures.showing.figure import drawn_anew, is_png
from palpate.procedures.showing.page import MOST, figure, of_things, page, pairs, rows, section, warning
from palpate.procedures.showing.points import show_result
from palpate.procedures.showing.runs import facts, shown_points
from palpate.procedures.showing.text import ends, legend, number
from palpate.procedures.showing.verdicts import show_verdicts
from palpate.procedures.steps.beside import sentence
from palpate.procedures.steps.flags import FLAGS

NAME, PAGES = "report", (".html",)
CALIBRATED = {
    "calibration": ("load cell", "load_cell"),
    "film_calibration": ("films", "films"),
    "model_calibration": ("model", "model"),
    "mounting_scatter": ("scatter of mountings", ""),
}  # by the keys of the header: what is calibrated, and its key in `calibration_files`
SHARED = (
    "u independent: as if the runs shared nothing. u shared: as if each contribution of kind B that both budgets have"
    " by one name, such as that of a calibration, were the same in both, so that only what it differs by is left. The"
    " truth lies between. A difference is told apart if both 95 % intervals leave out zero; ± is that of the wider one."
)


INDEPENDENT = (
    "Points of the same step are compared in their order, by the u of each, as if the runs shared nothing. What they do"
    " share, such as a calibration, makes differences smaller, so that fewer are beyond 2 u. An error that is common to"
    " the points of one run puts many of them beyond 2 u together, so judge by the results above."
)


@dataclass(frozen=True, slots=True)
class Reported:
    """A run for its report.

    Attributes:
        folder: its folder.
        run: the run; of a damaged one, what was salvaged.
        points: its points, as they are stored.
        facts: what it says of itself, by names.
        faults: what is damaged.
        found: its result; None: there is none.
        why: why there is none, or what differs from the record; empty: nothing.
        judged: the verdicts of limits; None: there are none.
    """

    folder: Path
    run: Run
    points: list[dict[str, Any]]
    facts: Mapping[str, str]
    faults: Sequence[str]
    found: RecordedResult | None
    why: str
    judged: Judgement | None

    @property
    def warning(self) -> str:
        """What to know before all else; empty: nothing."""
        if self.faults:
            first = f"this run is damaged, and the report shows what is whole: {'; '.join(self.faults)}"
        else:
            ended = "not ended, or was killed" if self.run.status == "running" else self.run.status
            first = "" if ended == "complete" else f"this run is {ended}, so points may be missing"
        return "; ".join(filter(None, (first, self.why.replace(str(self.run.folder), str(self.folder)))))

    @property
    def budgets(self) -> Sequence[Mapping[str, Any]]:
        """The budgets of the result, as the record has them."""
        if self.run.summary or self.found is None:
            stored: Any = self.run.summary.get("budgets", ())
            return stored  # type: ignore[no-any-return]
        return [each.summary() for each in self.found.result.budgets]


@contextmanager
def reported(folders: Iterable[Path], limits: LimitsFile | None = None) -> Iterator[list[Reported]]:
    """The runs in these folders for a report. Of a damaged one all that is whole is salvaged while the context lasts.

    Raises:
        RecordError: there is no run, or nothing of it is whole.
        UsageError: they are of unlike procedures, or one that is to be judged has no result.
        ConfigError: a result has no such quantity as a limit names.
    """
    with ExitStack() as stack:
        found = []
        for folder in folders:
            faults = check(folder).faults
            if faults:
                salvaged = Path(stack.enter_context(tempfile.TemporaryDirectory())) / folder.absolute().name
                with telling_damage(folder):
                    repair(folder, salvaged)
            run = Run.open(salvaged if faults else folder)
            if faults and limits:
                raise UsageError(f"{folder} is damaged, so it cannot be judged; leave out --limits")
            about = {"folder": str(folder.absolute()), **facts(run, run.digest(), run.signal_digest())}
            judged = judge(run, limits) if limits else None
            points = run.points()
            found.append(Reported(folder.absolute(), run, points, about, faults, *_result(run, points), judged))
        check_alike([each.run for each in found])
        yield found


def _result(run: Run, points: list[dict[str, Any]]) -> tuple[RecordedResult | None, str]:
    if not points:
        return None, "it has no point"
    try:
        found = result_of(run, points)
    except PalpateError as error:
        return None, f"its points give no result: {error}"
    except Exception as error:  # a package's procedure can fail in any way, and the points are shown all the same
        return None, f"its result cannot be evaluated anew ({type(error).__name__}: {error})"
    if found.changed:
        return found, f"this version of palpate computes other values than the record holds: {', '.join(found.changed)}"
    return found, ""


# --- the page ------------------------------------------------------------------------------------------


def report_page(reports: Sequence[Reported], comparisons: Sequence[ComparedRun]) -> str:
    """The page of one run, or that of several with their comparisons."""
    load_matplotlib()
    first, *others = reports
    simulated = any(each.run.simulated for each in reports)
    if not others:
        return page(f"{first.run.procedure}: {first.folder.name}", simulated, _sections(first, 1, 2))
    parts = [section("Comparison", _comparison(reports, comparisons))]
    for order, each in enumerate(reports, 1):
        parts.append(section(f"Run {order}: {each.folder.name}", _sections(each, order, 3)))
    return page(f"{first.run.procedure}: {len(reports)} runs compared", simulated, parts)


def _sections(each: Reported, order: int, level: int) -> Iterator[str]:
    run, found = each.run, each.found
    header: Mapping[str, Any] = run.header
    if each.warning:
        yield warning(each.warning)

    def part(heading: str, *parts: str) -> str:
        return section(heading, parts, level)

    yield part("Run", pairs(each.facts.items()))
    if found is not None:
        yield part("Result", *_shown(found, run.folder, f"{run.procedure} {order}"))
    if each.judged is not None:
        yield part("Verdicts", of_things(show_verdicts(each.judged, run.simulated)))
    yield part("Uncertainty budgets", of_things(show_budgets(each.budgets, run.simulated)))
    line, table = shown_points(run, each.points)
    yield part("Points as recorded", of_things([line, table, *legend(table, marks=FLAGS)]))
    beside = () if found is None else found.outcome.get("beside", ())
    sources = ((each["name"], f"{sentence(each)}, {each['field']} of {each['device']}") for each in beside)
    yield part("Beside the points", pairs(sources))
    yield part("Settings", rows(("setting", "value", "meaning"), _settings(run)))
    serials = _part(header, "devices")
    yield part("Devices", rows(("device", "serial number"), [(name, serials[name] or "-") for name in serials]))
    heads = ("calibration of", "source", "device", "created", "expires", "SHA-256", "rests on")
    yield part("Calibrations", rows(heads, _calibrations(header)))
    kept, left_out = ends(run.events(), MOST)
    events = [(f"{event['bench_ns'] / 1e9:z.1f}", event["kind"], event["message"]) for event in kept]
    yield part("Incidents and other events", rows(("bench time s", "kind", "what"), events, left_out=left_out))
    yield part("Software", pairs(_software(header).items()))


def _shown(found: RecordedResult, run: Path, name: str) -> Iterator[str]:
    """The result and its figure, if its procedure shows what there is; after few points it may be no whole result."""
    try:
        yield of_things(show_result(found.report, found.result, found.outcome))
        if found.report is not None:
            yield figure(found.report.draw, run, name)
    except Exception as error:  # as in `_result`
        yield warning(f"it cannot be shown ({type(error).__name__}: {error})")


def _settings(run: Run) -> Iterator[tuple[str, str, str]]:
    try:
        settings = {each.name: each.setting for each in asked_of(procedure_class(run.procedure))}
    except PalpateError:
        settings = {}
    for name, value in _part(run.header, "settings").items():
        setting = settings.get(name)
        value = tuple(map(_words, value)) if isinstance(value, list) else _words(value)
        unit = setting.unit if setting else ""
        yield name.replace("_", " "), shown(value, unit, sys.maxsize) or "-", setting.help if setting else ""


def _words(value: object) -> object:
    """What an entry of a list of settings says, where it is a table."""
    parts = value.items() if isinstance(value, dict) else ()
    return ", ".join(f"{name} {part}" for name, part in parts if part not in (None, "")) or value


def _calibrations(header: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    for key, (what, file) in CALIBRATED.items():
        if calibration := _part(header, key):
            cells = (str(calibration.get(name) or "-") for name in ("source", "device", "created", "expires"))
            stored = _part(_part(header, "calibration_files"), file)
            yield what, *cells, stored.get("sha256") or "-", _basis(key, calibration)


def _basis(key: str, calibration: Mapping[str, Any]) -> str:
    """What a calibration itself rests on."""
    if key == "film_calibration":
        return f"load cell {calibration.get('load_cell', '-')}"
    if key == "model_calibration":
        references = ", ".join(f"{each['name']}: {each['source']}" for each in calibration.get("references", ()))
        return f"references {references}; films {calibration.get('film_calibration') or 'by the design'}"
    return "dead weights" if key == "calibration" else "mountings of that run"


def _software(header: Mapping[str, Any]) -> dict[str, str]:
    own = {name: str(header.get(name) or "-") for name in ("commit", "contracts")}
    return {**_part(header, "versions"), **own, **_part(header, "arithmetic")}


def _part(header: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """A table of a header; empty: there is none."""
    found = header.get(key)
    return found if isinstance(found, dict) else {}


def draw_run(of: Reported, file: Path) -> None:
    """Draw the figure of a run into a new file.

    Raises UsageError: it has none, or none of this format; RecordError: the file cannot be written.
    """
    if of.found is None or of.found.report is None:
        raise UsageError(f"{of.folder} has no figure: {of.why or 'its procedure draws none'}")
    load_matplotlib()
    picture = drawn_anew(of.found.report.draw, of.run.folder, file.suffix)
    if file.suffix == ".svg" and is_png(picture):
        raise UsageError(f"{of.run.procedure} draws its figure as PNG alone; choose an --out that ends in .png")
    with storing(file):
        file.write_bytes(picture)


# --- the comparison ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ComparedRun:
    """A run compared with the first: their results, and their points; None: one of both gives no result."""

    results: Sequence[Difference]
    points: ComparedPoints | None


def compared(reports: Sequence[Reported]) -> list[ComparedRun]:
    """Each further run compared with the first."""
    first, *others = reports
    found = []
    for each in others:
        points = None
        if first.found is not None and each.found is not None:
            columns = number_columns(procedure_class(first.run.procedure).point)
            points = compared_points(columns, first.found.asked, first.points, each.points)
        found.append(ComparedRun(list(differences(first.budgets, each.budgets)), points))
    return found


def _comparison(reports: Sequence[Reported], comparisons: Sequence[ComparedRun]) -> Iterator[str]:
    for order, found in enumerate(comparisons, 2):
        values = ("run 1", "u", f"run {order}", "u")
        heads = ("quantity", *values, "difference", "u independent", "u shared", "± 95 %", "told apart")
        caption = f"Run {order} less run 1"
        nothing = of_things([f"{caption}: no result of both has a budget."])
        yield rows(heads, map(tuple, map(_row, found.results)), caption) or nothing
    yield of_things([SHARED])
    for order, found in enumerate(comparisons, 2):
        yield from _points_of(order, found.points)
    names = ["", *(f"run {which}" for which in range(1, len(reports) + 1))]
    yield rows(names, _side_by_side(reports), "The runs")


def _row(each: Difference) -> Iterator[str]:
    unit, u = each.first["unit"], (each.independent.u, each.shared.u)
    yield each.first["quantity"]
    for run_value in (each.first, each.other):
        yield from show_with_u(run_value["value"], run_value["u"], unit)
    yield show_with_u(each.shared.value, max(u), unit)[0]
    yield from (show(value, unit, 2) for value in (*u, each.half_width))
    yield "yes" if each.told_apart else "no"


def _points_of(order: int, found: ComparedPoints | None) -> Iterator[str]:
    """The points of a run beside those of the first."""
    caption = f"Points of run {order} less those of run 1"
    if found is None or not found.differences:
        yield of_things([f"{caption}: none of both are of one step and have an uncertainty."])
        return
    many, greatest = len(found.differences), found.differences[:GREATEST]
    step = greatest[0].step
    heads = (*step, "quantity", "run 1", "u", f"run {order}", "u", "difference", "u", "in u")
    yield rows(heads, map(_point_row, greatest), caption + (", the greatest ones" if many > GREATEST else ""))
    alone = " and ".join(f"{count:,} of run {which}" for count, which in zip(found.alone, (1, order), strict=True))
    yield of_things(
        [
            f"Beyond {FAR:g} u are {found.far:,} of {many:,} values of points; by chance alone some"
            f" {BY_CHANCE * many:,.0f} would be. {alone} have no value of the same step beside them. {INDEPENDENT}"
        ]
    )


def _point_row(each: PointDifference) -> list[str]:
    pairs = (show_with_u(of.value, of.u, each.unit) for of in (each.first, each.other))
    values = [text for pair in pairs for text in pair]
    difference = show_with_u(each.value, each.u, each.unit)
    return [*map(number, each.step.values()), each.quantity, *values, *difference, f"{each.in_u:+z.1f}"]


def _side_by_side(reports: Sequence[Reported]) -> Iterator[list[str]]:
    """What the runs say of themselves, and settings, devices, calibrations and software in which they differ."""
    own = [each.facts for each in reports]
    yield from ([name, *(each.get(name, "-") for each in own)] for name in own[0])
    headers: list[Mapping[str, Any]] = [each.run.header for each in reports]
    parts = [
        [{name: value for name, value, _ in _settings(each.run)} for each in reports],
        [{name.partition(" at ")[0]: serial for name, serial in _part(each, "devices").items()} for each in headers],
        [{f"calibration of {name}": " ".join(rest[:5]) for name, *rest in _calibrations(each)} for each in headers],
        list(map(_software, headers)),
    ]
    for part in parts:
        for name in dict.fromkeys(name for each in part for name in each):
            values = [each.get(name, "-") for each in part]
            if len(set(values)) > 1:
                yield [name, *values]


# --- the file ------------------------------------------------------------------------------------------


def write_page(text: str, out: Path | None, folder: Path) -> Path:
    """Write a page into a new file: `out`, or one in a folder, whose name has a number where it is taken.

    Returns the file. Raises RecordError: it cannot be written; UsageError: `out` was made meanwhile.
    """
    files = [out] if out else (folder / f"{name}.html" for name in numbered(NAME))
    for file in files:
        with storing(file, "another file with --out"), suppress(FileExistsError):
            file.touch(exist_ok=False)
            try:
                put_whole(file, text)
            except BaseException:
                file.unlink()
                raise
            return file.absolute()
    check_new(out, PAGES)
    raise AssertionError("numbers do not end")
