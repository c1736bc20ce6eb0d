"""The command palpate accuracy validation."""

from __future__ import annotations

import click

from palpate.procedures.commands.options import Output, StrictCommand, option, output_options


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate accuracy validation\n\n  palpate accuracy validation --design single --json",
)
@option("--design", help="single, common_base or different_base (default: all).")
@option("--store", is_flag=True, help="Solve the stored finite elements anew, and store them.")
@output_options
def validation(design: str | None, store: bool, as_json: bool, quiet: bool) -> None:
    """Show the difference of each sensor model from the thesis' experiments, sample by sample.

    It is the model minus the measured mean, in percent of the measured mean, so positive values mean that the model is
    higher. No mesh makes it smaller. A model that was built from the measured means is "input": they cannot judge it.
    """
    from palpate.instrument.errors import UnknownName, UsageError
    from palpate.instrument.models import validation as kept
    from palpate.instrument.notice import price
    from palpate.instrument.shipped import text
    from palpate.procedures.accuracy.keep import keep
    from palpate.procedures.showing.validation import print_validation

    output = Output(as_json, quiet)
    designs = kept.measured_designs()
    if design is not None and design not in designs:
        raise UnknownName("design with experiments", design, designs)
    if design is not None and store:
        raise UsageError("--design: not with --store, which always takes one sensor and the pairs")
    if store:
        with output.prices(), output.progress("solving") as progress:
            price("solving the stored finite elements anew", kept.SECONDS)
            keep(text(kept.measure(progress)), kept.STORED)
            kept.stored.cache_clear()
    compared = kept.validate_all(designs if design is None else [design])
    if output.as_json:
        output.json({"sign": kept.SIGN, "models": [each.record() for each in compared]})
    elif output.for_people:
        print_validation(compared)
