"""The command palpate test modulus."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from palpate.procedures.commands import options, texts
from palpate.procedures.commands.conducts import conducts
from palpate.procedures.commands.options import option

if TYPE_CHECKING:
    from palpate.procedures.measurements.modulus.procedure import ModulusTest


@click.group(cls=options.Group)
def test() -> None:
    """Test a sample on the bench, without the sensor."""


@test.command(
    epilog="Examples:\n\n  palpate test modulus --sample 1\n\n  palpate test modulus --sample 6 --strain '20 %'"
    " --steps 20 --budget\n\n  palpate test modulus --sample 2 --bench lab.toml --json"
)
@option("--sample", required=True, help="Rubber sample, by number.")
@option("--strain", callback=texts.quantity("", "30 %"), default="30 %", help="Largest strain.")
@option("--steps", default=10, help="Number of equal steps up to it, and back.")
@options.extrapolate_option
@options.DRY_RUN
@options.bench_options
@options.budget_option
@conducts()
def modulus(sample: str, strain: float, steps: int, extrapolate: bool) -> ModulusTest:
    """Compress a sample with the micro-positioner and find its Young modulus (thesis 5.3, Tables 5.2 and 5.3).

    A rigid support takes the sensor's place. Pressing the bare support gives the compliance of suspension and load
    cell, which is corrected for. Pressing the sample on it gives stress and strain, tangent and secant modulus, for
    loading and unloading, each with its standard uncertainty. Loads below the calibrated range are marked.
    """
    from palpate.procedures.measurements.modulus.procedure import ModulusTest

    return ModulusTest(sample, strain, steps, extrapolate)
