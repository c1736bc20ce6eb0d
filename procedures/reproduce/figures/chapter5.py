"""The figures of chapter 5 by number: the set-up, the orders of softness, and experiments beside theories."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType

from palpate.procedures.reproduce.curves import Curves
from palpate.procedures.reproduce.figures import experiments, orders, setup
from palpate.procedures.reproduce.figures.measured import Measured
from palpate.procedures.reproduce.figures.picture import Picture

# Function of measurements, parameter sets, curves and folder that draws a picture.
Draw = Callable[[Measured, Sequence[str], Curves, Path], Picture]


def _measured(draw: Callable[[Measured, Path], Picture]) -> Draw:
    """A drawing that needs neither parameter sets nor curves."""
    return lambda measured, _parameters, _curves, folder: draw(measured, folder)


FIGURES: Mapping[str, Draw] = MappingProxyType(
    {
        setup.NUMBER: _measured(setup.draw),
        orders.BY_MODULUS: _measured(orders.draw_moduli),
        **{number: _measured(partial(orders.draw_ratios, design)) for design, (number, _) in orders.BY_RATIO.items()},
        experiments.ALONE: _measured(experiments.draw_all),
        **{figure.number: partial(experiments.draw, figure) for figure in experiments.WITH_THEORIES},
    }
)
