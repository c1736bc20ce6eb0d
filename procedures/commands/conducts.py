"""The decorator of commands that return a procedure: it plans the procedure or carries it out."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING

from palpate.procedures.commands.options import Choice, Output

if TYPE_CHECKING:
    from palpate.procedures.engine.procedure import P, Procedure, R, S


def conducts(scene: str | None = None) -> Callable[[Callable[..., Procedure[S, P, R]]], Callable[..., None]]:
    """Carry out the procedure that a command returns, on the bench of its options; with --dry-run, only plan it.

    Args:
        scene: scene that is simulated if the options name neither a scene nor a bench; None: the usual one.
    """

    def decorated(command: Callable[..., Procedure[S, P, R]]) -> Callable[..., None]:
        @functools.wraps(command)
        def carried_out(
            *, choice: Choice, output: Output, model: str | None = None, dry_run: bool = False, **settings: object
        ) -> None:
            from palpate.procedures.commands.procedures import measure, plan

            chosen = choice if scene is None else choice.simulated_on(scene)
            (plan if dry_run else measure)(command(**settings), chosen, output, model)

        return carried_out

    return decorated
