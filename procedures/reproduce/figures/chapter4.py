"""The figures of chapter 4 by number: curves beside the thesis' tables, and its schematics drawn from our own parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType

from palpate.instrument.thesis import contents
from palpate.procedures.reproduce.curves import Curves
from palpate.procedures.reproduce.figures import area_ratios, beam, elements, mesh, pressed, ratios, sections
from palpate.procedures.reproduce.figures.picture import Picture

# Function of parameter sets, curves and folder that draws a picture.
Draw = Callable[[Sequence[str], Curves, Path], Picture]


def _scheme(draw: Callable[[Path], Picture]) -> Draw:
    """A drawing that needs neither parameter sets nor curves."""
    return lambda _parameters, _curves, folder: draw(folder)


_DRAWN: Mapping[str, Draw] = {
    **{number: _scheme(partial(sections.draw, number)) for number in sections.SENSORS},
    "Figure 4.2": _scheme(beam.draw_springs),
    "Figure 4.3": _scheme(beam.draw_elements),
    area_ratios.NUMBER: _scheme(area_ratios.draw),
    elements.NUMBER: _scheme(elements.draw),
    mesh.NUMBER: _scheme(mesh.draw),
    **{figure.number: partial(ratios.draw, figure) for figure in ratios.RATIO_FIGURES},
    pressed.NUMBER: _scheme(pressed.draw),
}
# Figures in the order of the thesis.
FIGURES: Mapping[str, Draw] = MappingProxyType({number: _DRAWN[number] for number in contents() if number in _DRAWN})
