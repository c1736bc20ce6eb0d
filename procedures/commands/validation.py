"""The command palpate accuracy validation."""

from __future__ import annotations

import click

from palpate.procedures.commands.options import Command, Output, option, output_options


@click.command(
    cls=Command,
    epilog="Examples:\n\n  palpate accuracy validation\n\n  palpate accuracy validation --design single --json"
    "\n\n  palpate accuracy validation --what-if",
)
@option("--design", help="single, common_base or different_base (default: all).")
@option("--what-if", "causes", is_flag=True, help="Show how far possible causes move models from experiments.")
@option("--store", is_flag=True, help="Solve the stored finite elements anew, and store them.")
@output_options
def validation(design: str | None, causes: bool, store: bool, as_json: bool, quiet: bool) -> None:
    """Show the difference of each sensor model from the thesis' experiments, sample by sample.

    It is the model minus the measured mean, in percent of the measured mean, so positive values mean that the model is
    higher. No mesh makes it smaller. A model that was built from the measured means is "input": they cannot judge it.
    With --what-if: how much friction, load, geometry, rubber and base each change one sensor and a pair, and what the
    readings themselves show.
    """
    from palpate.instrument.errors import UnknownName, UsageError
    from palpate.instrument.models import validation as kept
    from palpate.instrument.notice import price
    from palpate.instrument.shipped import text
    from palpate.procedures.accuracy import what_if
    from palpate.procedures.accuracy.causes import Causes
    from palpate.procedures.accuracy.causes_report import print_causes
    from palpate.procedures.accuracy.keep import keep
    from palpate.procedures.reproduce.solutions import Solutions
    from palpate.procedures.showing.validation import print_validation

    output = Output(as_json, quiet)
    designs = kept.measured_designs()
    if design is not None and design not in designs:
        raise UnknownName("design with experiments", design, designs)
    if design is not None and (causes or store):
        raise UsageError("--design: not with --what-if or --store, which always take one sensor and the pairs")
    solutions = Solutions() if store else Solutions.shipped(what_if.STORED, kept.RENEW)
    with output.prices(), output.progress("solving") as progress:
        if store:
            price("solving the stored finite elements anew", what_if.SECONDS)
            keep(text(kept.measure(progress)), kept.STORED)
            kept.stored.cache_clear()
        found = Causes.of(solutions, progress) if causes or store else None
    if store:
        keep(solutions.text(), what_if.STORED)
    compared = kept.validate_all(designs if design is None else [design])
    if output.as_json:
        result = {"sign": kept.SIGN, "models": [each.record() for each in compared]}
        output.json({**result, **(found.record() if found and causes else {})})
    elif output.for_people:
        if found and causes:
            print_causes(found)
        else:
            print_validation(compared)
