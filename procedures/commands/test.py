"""The command palpate test modulus."""

from __future__ import annotations

import click

from palpate.procedures.commands.options import Choice, Group, Output, bench_options, budget_option, extrapolate_option


@click.group(cls=Group)
def test() -> None:
    """Test a sample on the bench, without the sensor."""


@test.command(
    epilog="Examples:\n\n  palpate test modulus --sample 1\n\n  palpate test modulus --sample 6 --strain '20 %'"
    " --steps 20 --budget\n\n  palpate test modulus --sample 2 --bench lab.toml --json"
)
@click.option("--sample", required=True, help="Rubber sample, by number.")
@click.option("--strain", default="30 %", show_default=True, help="Largest strain.")
@click.option("--steps", default=10, show_default=True, help="Number of equal steps up to it, and back.")
@extrapolate_option
@bench_options
@budget_option
def modulus(sample: str, strain: str, steps: int, extrapolate: bool, choice: Choice, output: Output) -> None:
    """Compress a sample with the micro-positioner and find its Young modulus (thesis 5.3, Tables 5.2 and 5.3).

    A rigid support takes the sensor's place. Pressing the bare support gives the compliance of suspension and load
    cell, which is corrected for. Pressing the sample on it gives stress and strain, tangent and secant modulus, for
    loading and unloading, each with its standard uncertainty. Loads below the calibrated range are marked.
    """
    from palpate.instrument.quantity import parse
    from palpate.procedures.commands.procedures import measure
    from palpate.procedures.measurements.modulus.procedure import ModulusTest

    measure(ModulusTest(sample, parse(strain, ""), steps, extrapolate), choice, output)
