"""The matrix of faults: what comes of every fault on everything that can have it, in every procedure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.table import Table

from palpate.simulators.planning.settle import read_scene
from tests.benchmarks.row import Row
from tests.fault_matrix import ONCE, STAYS, Cell, Outcome, Scenes, play_all
from tests.fault_procedures import PROCEDURES, real_bench
from tests.fault_procedures import scene as usual
from tests.operations import operations, without_code_of_faults


def measure() -> Iterator[Row]:
    """Play all cells and print them; rows say how many are green, and what faults cost where there are none."""
    yield _matrix("fault matrix", tuple(PROCEDURES), usual)
    yield _matrix("fault matrix of real_bench", ("sweep loads",), real_bench)
    scene = read_scene("thesis_single")
    operations(scene)  # fills what is kept between benches
    with_code = operations(scene)
    with without_code_of_faults():
        without = operations(scene)
    yield Row(
        "operations in a bench's life without faults: with their code, without it",
        f"{with_code.total()}, {without.total()}",
        "equal",
        with_code == without,
    )


def _matrix(title: str, procedures: Sequence[str], of: Scenes) -> Row:
    """Play all cells of a bench and print them; the row says how many are green."""
    outcomes = play_all(procedures, of)
    table = Table(
        title=f"{title}; r: right, m: marked, s: stopped, with the incidents in the record; fault once, then for good",
        box=None,
        padding=(0, 1, 0, 0),
    )
    table.add_column("fault")
    table.add_column("on")
    for procedure in procedures:
        table.add_column(procedure.replace(" ", "\n"), no_wrap=True)
    for kind, on, more in dict.fromkeys((cell.kind, cell.on, cell.more) for cell in outcomes):
        setting = f" {more[0][1]} = {more[1][1]:g}" if more else ""
        row = [[outcomes[Cell(name, kind, on, lasts, more)] for lasts in (ONCE, STAYS)] for name in procedures]
        table.add_row(kind + setting, on, *(" ".join(map(_shown, pair)) for pair in row))
    console = Console(width=160, highlight=False)
    console.print(table)
    wrong = {cell: outcome for cell, outcome in outcomes.items() if outcome.verdict == "WRONG"}
    for cell, outcome in wrong.items():
        console.print(f"WRONG: {cell.name}: {outcome.said}")
    return Row(
        f"{title}: cells right, marked or stopped with outputs at zero",
        f"{len(outcomes) - len(wrong)} of {len(outcomes)}",
        "all",
        not wrong,
    )


def _shown(outcome: Outcome) -> str:
    letter = outcome.verdict if outcome.verdict == "WRONG" else outcome.verdict[0]
    return f"{letter}{outcome.incidents or ''}"
