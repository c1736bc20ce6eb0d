"""The films of a design are complete: each tooth's film has a base's film, and no name, channel or tooth is wrong."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.instrument.errors import RangeError
from palpate.instrument.sensor.designs import COMMON_BASE, SINGLE

RIGID, TOTAL = sorted(SINGLE.films, key=lambda film: film.name)


@pytest.mark.parametrize(
    ("films", "says"),
    [
        ((RIGID,), "film 'rigid': there must be a 'total' film that takes the force of its teeth, too"),
        ((TOTAL,), "has no film whose name begins with 'rigid'"),
        ((RIGID, TOTAL, replace(TOTAL, name="spare", channel=3)), "film 'spare': its name must begin with 'rigid' or"),
        ((RIGID, replace(TOTAL, channel=RIGID.channel)), "film 'rigid': its name, and its channel 1 from 1, must be"),
        ((replace(RIGID, channel=0), TOTAL), "film 'rigid': its name, and its channel 0 from 1, must be"),
        ((RIGID, TOTAL, replace(TOTAL, channel=3)), "film 'total': its name, and its channel"),
        ((RIGID, replace(TOTAL, teeth=(0, 1))), "film 'total': its teeth (0, 1) must be one or more of the numbers 0"),
        ((replace(RIGID, teeth=()), TOTAL), "film 'rigid': its teeth () must be one or more of the numbers 0 to 0"),
    ],
)
def test_films_that_give_no_force_ratio_are_refused(films: tuple[object, ...], says: str) -> None:
    with pytest.raises(RangeError) as caught:
        replace(SINGLE, films=films)  # type: ignore[arg-type]
    assert says in str(caught.value)
    assert str(caught.value).startswith("design 'single': ")


def test_a_film_under_a_tooth_needs_the_film_under_its_own_base() -> None:
    rigid = [film for film in COMMON_BASE.films if film.kind == "rigid"]
    (base,) = (film for film in COMMON_BASE.films if film.kind == "total")
    with pytest.raises(RangeError, match="'total' film that takes the force of its teeth"):
        replace(COMMON_BASE, films=(*rigid, replace(base, teeth=(0,))))
