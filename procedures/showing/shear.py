"""Prints the effect of shear on the films."""

from __future__ import annotations

from collections.abc import Mapping

from palpate.instrument.models.shear import ALIKE, DRAGGED, FilmShear, shear_pattern
from palpate.procedures.showing.text import NO_VALUE, legend, new_table, print_all, stamped

TOLD = {
    "not": "No film responds to shear along the line of the teeth.",
    "off centre": "All films that respond to shear give the same place of a load: shear looks like a load off centre.",
    "apart": f"The films give places of a load that differ by more than {100 * ALIKE:g} %: together they can tell shear"
    " from a load off centre.",
}


def print_shear(what: str, films: Mapping[str, FilmShear], coarse: Mapping[str, FilmShear]) -> None:
    """Print a row for each film: its force for 1 N of shear, and the place of a normal load that adds as much.

    Args:
        what: title of the table.
        films: the forces on the films, by film name.
        coarse: the same forces on the next coarser mesh.
    """
    table = new_table(
        stamped(False, f"{what}: forces on films for 1 N, and the place of a load that adds as much"),
        "film", "pressed\nN", *(text for place in DRAGGED for text in (f"shear on\n{place}, N", "off centre\nmm N/N")),
        "change\nN",
    )  # fmt: skip
    table.columns[0].justify = "left"
    for name, film in films.items():
        cells = []
        for place in DRAGGED:
            off = film.off_centre(place)
            cells += [f"{film.cleaned(place):+z.5f}", "-" if off is None else f"{1e3 * off:+z.3f}"]
        table.add_row(name, f"{film.pressed:z.4f}", *cells, f"{film.change(coarse[name]):z.5f}")
    print_all(table, *legend(table, marks=NO_VALUE), TOLD[shear_pattern(films)])
