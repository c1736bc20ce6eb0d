"""The command palpate measure modulus."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, cast

import click

from palpate.procedures.commands import options, texts
from palpate.procedures.commands.options import option
from palpate.procedures.commands.settings import SettingsCommand

if TYPE_CHECKING:
    from palpate.instrument.sensor.design import Design
    from palpate.instrument.sensor.sample import Sample


@click.command(
    "modulus",
    cls=SettingsCommand,
    procedure="measure-modulus",
    optional=("object",),
    epilog="Examples:\n\n  palpate measure modulus --sample 4 --tolerance '5 %' --relative-to-model"
    "\n\n  palpate measure modulus --modulus '60 kPa' --time '2 min' --json"
    "\n\n  palpate measure modulus --bench lab.toml --tolerance '20 %' --dry-run",
)
@option(
    "--modulus",
    callback=texts.quantity("Pa", positive=True),
    help="Young modulus of an unknown object; on a real bench a guess.",
)
@options.thickness_option
@options.DRY_RUN
@options.bench_options
@options.budget_option
def modulus(
    modulus: float | None,
    thickness: float | None,
    settings: Mapping[str, object],
    dry_run: bool,
    choice: options.BenchChoice,
    output: options.Output,
) -> None:
    """Measure the Young modulus of one object to a tolerance, or as well as a time allows.

    Before anything moves, a plan says how often the object is mounted, how many load sets there are, under which load
    and for how long, what that takes and what it is expected to give. A tolerance that no time reaches is refused, with
    the line that binds and other ways. On a real bench 50 kPa are expected of an object without --modulus.
    """
    from palpate.instrument.additions import check_ours
    from palpate.procedures.commands.procedures import chosen_by, measure, plan
    from palpate.procedures.engine.catalogue import GROUP, WHAT
    from palpate.procedures.engine.settings import made
    from palpate.procedures.measurements.object_modulus.procedure import ObjectModulus

    check_ours(GROUP, WHAT, ["modulus"])  # the command's name is reserved
    design = chosen_by(choice).target.design
    sample = cast("Sample | None", settings.get("object"))
    touched = object_to_touch(design, sample, modulus, thickness, real=choice.bench is not None)
    (plan if dry_run else measure)(made(ObjectModulus, {**settings, "object": touched}), choice, output)


def object_to_touch(
    design: Design, sample: Sample | None, modulus: float | None, thickness: float | None, real: bool
) -> Sample:
    """The object to mount.

    Raises UsageError: sample and modulus are both given, or neither for a simulated bench; or a sample and a thickness.
    """
    from palpate.instrument.errors import UsageError
    from palpate.procedures.measurements.object_modulus.procedure import UNKNOWN
    from palpate.procedures.measurements.softness.procedure import unknown_object

    if sample is not None and modulus is not None:
        raise UsageError("--sample and --modulus: give either a sample or the modulus of an unknown object, not both")
    thick = options.unknown_thickness(thickness, sample)
    if sample is not None:
        return sample
    if modulus is None and not real:
        raise UsageError("--sample or --modulus is missing: name the object that the simulated bench touches")
    return unknown_object(design, thick, UNKNOWN if modulus is None else modulus, "unknown" if real else None)
