"""Values that a shell completes: scenes, models and runs. What lists them is imported only when it is asked."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

Complete = Callable[[click.Context, click.Parameter, str], "list[CompletionItem]"]

MODELS = (
    "column", "column_fitted", "beam", "beam_exact", "beam_printed", "experiment", "surface", "axisymmetric", "solid",
)  # fmt: skip  # their table would import numpy


def _completed(names: Callable[[], Iterable[str]], *, file: bool) -> Complete:
    """Completes one of some names, or the name of a file or folder."""

    def complete(_ctx: click.Context, _param: click.Parameter, begun: str) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        fitting = [CompletionItem(name) for name in names() if name.startswith(begun)]
        return fitting or ([CompletionItem(begun, type="file")] if file else [])

    return complete


def _scenes() -> list[str]:
    from palpate.procedures.virtual.scene_list import names

    return names()


def _runs() -> list[str]:
    from palpate.procedures.lab.store import store
    from palpate.procedures.records.run_folder import is_run

    folders = Path(store())
    return sorted(path.name for path in folders.iterdir() if is_run(path)) if folders.is_dir() else []


scene = _completed(_scenes, file=True)
model = _completed(lambda: (*MODELS, "auto"), file=False)
run = _completed(_runs, file=True)

SCENE = click.argument("scene", shell_complete=scene)
RUN = click.argument("run", shell_complete=run)
