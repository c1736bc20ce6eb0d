"""Runs a procedure for a command: plans or measures it, and shows the result."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.errors import PalpateError, RecordError, UsageError
from palpate.procedures.commands.options import BenchChoice, Output
from palpate.procedures.console.terminal import say
from palpate.procedures.engine.procedure import Finished, P, Procedure, R, S, expected_of
from palpate.procedures.engine.run import open_and_run, prepared
from palpate.procedures.lab import operator
from palpate.procedures.lab.about import completed, given
from palpate.procedures.lab.chosen import Chosen, choose
from palpate.procedures.lab.session import places
from palpate.procedures.lab.store import store
from palpate.procedures.showing.points import show_result
from palpate.procedures.showing.text import print_all, where
from palpate.procedures.steps.pause import NOBODY

if TYPE_CHECKING:
    from palpate.instrument.uncertainty.budget import Budget, Propagated
    from palpate.procedures.engine.plan import Plan
    from palpate.procedures.engine.verdict import Judgement, LimitsFile
    from palpate.procedures.records.run import Run


def chosen_by(choice: BenchChoice, model: str | None = None) -> Chosen:
    """The bench that a command will open. Raises as `choose` does."""
    if choice.bench is not None and choice.pace is not None:
        raise UsageError("--pace: only for a simulated bench; leave this out, or leave out --bench")
    chosen = choose(choice.bench, choice.scene, choice.seed, model, None, choice.assume_mounted)
    return replace(chosen, pace=choice.pace)


def chosen_for(procedure: Procedure[S, P, R], choice: BenchChoice, output: Output, model: str | None) -> Chosen:
    """The bench for a procedure: with --fidelity, without the effects that its result does not feel.

    Raises as `choose`, `refuse` and `at_fidelity` do.
    """
    chosen = chosen_by(choice, model)
    if choice.fidelity is None:
        return chosen
    from palpate.procedures.lab.chosen import FIDELITY, at_fidelity

    procedure, ahead, _ = prepared(procedure, chosen.target)
    with output.prices():
        chosen = at_fidelity(chosen, choice.fidelity, procedure.name, procedure.dwells(), ahead.seconds)
    if chosen.scene is not None and not output.quiet:
        left_out = ", ".join(chosen.scene.file.left_out or ()) or "nothing"
        say(
            f"palpate: note: {FIDELITY} {choice.fidelity:g} leaves out of scene {chosen.scene.name}: {left_out}",
            err=True,
        )
    return chosen


def limits_given(output: Output) -> LimitsFile | None:
    """The limits of a command; None: it has none. Raises ConfigError."""
    from palpate.procedures.engine.verdict import read_limits

    return None if output.limits is None else read_limits(output.limits)


def check_limits(limits: LimitsFile, procedure: Procedure[S, P, R], ahead: Plan[S], output: Output) -> None:
    """Refuse limits that no result of a plan can have; tell of those that only the result tells, or cannot decide."""
    declared = {
        f"only the result tells whether it has what {limits.where} limits": limits.open_names(
            procedure.point, [each.name for each in expected_of(ahead)]
        ),
        "there is no standard uncertainty, so the verdict will be undecided": limits.without_u(procedure.point),
    }
    for what, names in declared.items():
        if names and not output.quiet:
            say(f"palpate: note: {what}: {', '.join(names)}", err=True)


def measure(procedure: Procedure[S, P, R], choice: BenchChoice, output: Output, model: str | None = None) -> int:
    """Carry out a procedure on the bench of a command, and show its result. Raises as `open_and_run` does.

    Limits are checked, and what a run on a bench file will take is told, before the bench is opened.

    Returns: the exit status.
    """
    limits = limits_given(output)
    chosen = chosen_for(procedure, choice, output, model)
    if limits is not None:
        check_limits(limits, *prepared(procedure, chosen.target)[:2], output)
    about = completed(given(choice.about), store(), operator.answer if operator.at_terminal() else None)
    chosen = replace(chosen, about=about)
    if choice.bench is not None and output.for_people:
        from palpate.procedures.showing.plan import announce

        announce(prepared(procedure, chosen.target)[1])
    keyboard = operator.keyboard() if procedure.pausable else nullcontext(NOBODY)
    with output.prices(), output.served(procedure.pausable) as output:
        with keyboard as keys, output.listener() as listener:
            pause = output.pause(keys)
            done = open_and_run(procedure, chosen, out=choice.out, log=choice.log, listener=listener, pause=pause)
        return tell(procedure, done, output, limits)


def plan(procedure: Procedure[S, P, R], choice: BenchChoice, output: Output, model: str | None = None) -> None:
    """Show what a procedure would do, without sending anything. Raises what the procedure's checks raise."""
    from palpate.procedures.showing.plan import print_plan

    limits = limits_given(output)
    chosen = chosen_for(procedure, choice, output, model)
    chosen.check_beside()
    target = chosen.target
    procedure, ahead, doubt = prepared(procedure, target)
    if limits is not None:
        check_limits(limits, procedure, ahead, output)
    with places(choice.out, choice.log, procedure.name, datetime.now(UTC)):
        pass  # this only checks that they can be written; the empty folder is removed again
    output.result(ahead.summary, lambda: print_plan(ahead))
    if doubt and not output.quiet:
        say(f"palpate: note: {doubt}", err=True)


def tell(procedure: Procedure[S, P, R], done: Finished[R], output: Output, limits: LimitsFile | None = None) -> int:
    """Draw the plot of a finished run, and show its result with the verdicts of its limits.

    Returns: the exit status: 0, or that of the verdicts.

    Raises:
        ConfigError: the result has no such quantity as a limit names.
        EstimateError: the points give no result.
        RecordError: a file cannot be written, the report crashed, or the calibration is not stored.
    """
    with after(done.folder):
        if done.unstored is not None:
            raise done.unstored
        outcome = done.outcome
        rows, summary = [asdict(point) for point in done.result.points], done.result.summary()
        described = done.session.lab.bench.description
        if described.beside or described.load_channel:
            for row, stored in zip(rows, done.run.points(), strict=True):
                row |= {name: value for name, value in stored.items() if name not in {*row, "id", "bench_ns"}}
        found: dict[str, object] = {**outcome, "points": rows, **summary}
        report = procedure.report(done.result, done.session.lab)
        plot = None if report is None else report.draw(done.folder)
        if plot is not None:
            found["plot"] = str(plot)

        def show() -> list[object]:
            return [*show_result(report, done.result, outcome), *where(outcome, plot)]

        if limits is None:
            tell_result(output, found, show, done.result.budgets)
            procedure.check_result(done.result)
            return 0
        from palpate.procedures.engine.verdict import judge

        judged = judge(done, limits)
        if output.page is not None:
            output.page.tell("verdict", judged.summary())
        tell_result(output, {**found, **judged.summary()}, show, done.result.budgets)
        status = tell_verdicts(judged, done.run, output)
        procedure.check_result(done.result)
        return status


def tell_verdicts(judged: Judgement, run: Run, output: Output) -> int:
    """Show verdicts to people, and write them for other programs. Returns the exit status. Raises RecordError."""
    if output.for_people:
        from palpate.procedures.showing.verdicts import show_verdicts

        print_all(*show_verdicts(judged, run.simulated))
    if output.junit is not None:
        from palpate.procedures.showing.junit import write_junit

        write_junit(judged, run, output.junit)
    return judged.status


@contextmanager
def after(folder: Path) -> Iterator[None]:
    """A context for the work after a finished run; its errors name the run's folder."""
    try:
        yield
    except (PalpateError, OSError, KeyboardInterrupt) as error:
        error.add_note(f"the run is kept in {folder}; look at it with palpate runs show")
        raise
    except Exception as error:  # plotting uses libraries, fonts and file formats that can fail in any way
        raise RecordError(
            f"the run is kept in {folder}, but its report crashed ({type(error).__name__}: {error}); "
            "look at the run with palpate runs show"
        ) from error


def tell_result(
    output: Output,
    found: Mapping[str, object],
    show: Callable[[], Sequence[object]],
    budgets: Sequence[Budget | Propagated] = (),
) -> None:
    """Show the result of a run, as JSON or by `show` for people, with its budgets if they are asked for."""
    written = [each.summary() for each in budgets] if output.budgets else []
    if output.as_json:
        output.json({**found, "budgets": written} if output.budgets else found)
    elif output.for_people:
        from palpate.procedures.showing.budget import show_budgets

        print_all(*show(), *show_budgets(written, bool(found["simulated"])))
        if output.budgets and not budgets:
            say("this procedure gives no uncertainty budget; its points and results have their uncertainties")
