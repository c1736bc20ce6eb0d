"""The command palpate test modulus."""

from __future__ import annotations

import click

from palpate.procedures.commands.options import StrictGroup
from palpate.procedures.commands.settings import conducting


@click.group(cls=StrictGroup)
def test() -> None:
    """Test a sample on the bench, without the sensor."""


modulus = conducting(
    "modulus",
    "test-modulus",
    """Compress a sample with the micro-positioner and find its Young modulus (thesis 5.3, Tables 5.2 and 5.3).

    A rigid support takes the sensor's place. Pressing the bare support gives the compliance of suspension and load
    cell, which is corrected for. Pressing the sample on it gives stress and strain, tangent and secant modulus, for
    loading and unloading, each with its standard uncertainty. Loads below the calibrated range are marked.
    """,
    "palpate test modulus --sample 1",
    "palpate test modulus --sample 6 --strain '20 %' --steps 20 --budget",
    "palpate test modulus --sample 2 --bench lab.toml --json",
)
test.add_command(modulus)
