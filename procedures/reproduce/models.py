"""Chapter 4 of the thesis, its tables in Appendix II and the theories of Table 5.8, beside the models."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import MappingProxyType

from palpate.instrument.errors import UnknownName
from palpate.procedures.console.progress import Progress
from palpate.procedures.reproduce import chapter4, figures
from palpate.procedures.reproduce.curves import RINGS, CurveCase, Curves, Solutions
from palpate.procedures.reproduce.figures import SavedPicture
from palpate.procedures.reproduce.files import write_summary, write_table
from palpate.procedures.reproduce.rows import Comparison

PROCEDURE = "reproduce-models"
SETS = ("physical", "identified")
BOTH = "both"

Compare = Callable[[Sequence[str], Curves], Comparison]
# Tables in the order in which they are made.
TABLES: Mapping[str, Compare] = MappingProxyType(
    {
        **{number: partial(chapter4.compare_single, number) for number in ("A2.1", "4.1", "A2.2", "4.2")},
        **{
            number: partial(chapter4.compare_pair, number)
            for number in ("A2.3", "4.5", "A2.5", "4.3", "A2.4", "4.6", "A2.6", "4.4")
        },
        "A2.7": chapter4.compare_position,
        "5.8": chapter4.compare_theories,
    }
)


SECONDS, FRESH = 7.0, 12.0  # s of processor time that `run` takes for both sets, by known solutions and anew [M]


@dataclass(slots=True)
class Reproduction:
    """Tables and pictures that are done so far, with their files in `folder`; `summary` lists all."""

    folder: Path
    tables: list[tuple[Comparison, Path]] = field(default_factory=list)
    pictures: list[SavedPicture] = field(default_factory=list)
    summary: Path | None = None


def parameter_sets(name: str) -> tuple[str, ...]:
    """Names of the parameter sets that "physical", "identified" or "both" means.

    Raises:
        UnknownName: it is none of these.
    """
    if name not in (*SETS, BOTH):
        raise UnknownName("parameter set", name, (*SETS, BOTH))
    return SETS if name == BOTH else (name,)


def cases(parameters: Sequence[str]) -> list[CurveCase]:
    """Every curve that tables and figures need."""
    pairs = [
        chapter4.pair_cases(parameters, design, ring) for design in ("common_base", "different_base") for ring in RINGS
    ]
    singles = [chapter4.single_cases(parameters, ring) for ring in RINGS]
    wanted = [case for cases in (*singles, *pairs) for case in cases.values()]
    return [*wanted, *figures.model_cases(parameters), *figures.bench_cases(parameters)]


def run(parameters: Sequence[str], done: Reproduction, progress: Progress, fresh: bool = False) -> Curves:
    """Make all tables, then the figures, then the summary. Each is on disk and in `done` before the next begins.

    Returns the curves, which the figures of chapter 5 need as well.

    Args:
        parameters: names of the parameter sets.
        done: is filled.
        progress: is told of each solution.
        fresh: whether everything is solved anew and the solutions are written, instead of using known ones.

    Raises:
        EstimateError: a linear system cannot be solved accurately.
        RecordError: a file cannot be written.
    """
    solutions = Solutions() if fresh else Solutions.shipped()
    curves = Curves(
        cases(parameters), extra=len(chapter4.position_sets(parameters)), progress=progress, solutions=solutions
    )
    try:
        for compare in TABLES.values():
            comparison = compare(parameters, curves)
            done.tables.append((comparison, write_table(comparison, done.folder)))
            if comparison.table.number == "A2.7":
                done.pictures.append(figures.draw_position(comparison, done.folder))
        for picture in figures.model_pictures(parameters, curves, done.folder):
            done.pictures.append(picture)
    finally:
        if done.tables:  # also after an interruption
            done.summary = write_summary(done.tables, done.pictures, done.folder)
    if fresh:
        solutions.write(done.folder)
    return curves
