"""Ten to twenty teeth on one base, in a regular pattern: the grasper that section 3.2 of the thesis proposes."""

from __future__ import annotations

from palpate.instrument.errors import RangeError
from palpate.instrument.sensor.design import Design, Film, FilmSheet, Plate
from palpate.instrument.sensor.designs.single import SINGLE
from palpate.instrument.sensor.film_material import PVDF
from palpate.instrument.sensor.material import PLEXIGLAS_THESIS

FEWEST, MOST = 10, 20
PITCH = 12e-3  # [A] as between the two teeth of the common base


def array_of(count: int) -> Design:
    """An array of `count` teeth in two rows, with one film under each tooth and one under the base.

    The thesis proposes arrays and measured none: films are the single sensor's [A].

    Raises:
        RangeError: the count is odd, or outside 10 to 20.
    """
    if not (FEWEST <= count <= MOST) or count % 2:
        raise RangeError(f"array of {count} teeth: two equal rows of {FEWEST} to {MOST} in all; give an even count")
    columns = count // 2
    rigid, total = SINGLE.film("rigid"), SINGLE.film("total")
    length, width = columns * PITCH, 2 * PITCH
    # A film's open-circuit voltage falls as its area grows.
    spread = SINGLE.film_sheet.length * SINGLE.film_sheet.width / (length * width)
    return Design(
        name="array" if count == FEWEST + 2 else f"array_{count}",
        tooth=SINGLE.tooth,
        ring=SINGLE.ring,
        plate=Plate(length=length, width=width, thickness=SINGLE.plate.thickness, material=PLEXIGLAS_THESIS),
        plate_count=2,
        teeth=tuple(((i + 0.5) * PITCH, (j + 0.5) * PITCH) for j in range(2) for i in range(columns)),
        film_sheet=FilmSheet(disc_radius=1.4e-3, length=length, width=width, thickness=25e-6, material=PVDF),
        films=(
            *(
                Film(
                    name=f"rigid_{k + 1}",
                    channel=k + 1,
                    sensitivity=rigid.sensitivity,
                    scatter=rigid.scatter,
                    teeth=(k,),
                )
                for k in range(count)
            ),
            Film(
                name="total",
                channel=count + 1,
                sensitivity=total.sensitivity * spread,
                scatter=total.scatter,
                teeth=tuple(range(count)),
            ),
        ),
        # [A] Teeth are independent of each other; each goes with the base as the single sensor's does.
        scatter_correlation={
            (f"rigid_{k + 1}", "total"): SINGLE.scatter_correlation["rigid", "total"] for k in range(count)
        },
        thesis_force_ratio={},
        thesis_softness_order=(),
        source="[T] 3.2, 4.4 (2 (N + 1) electrodes); pitch, pattern and sensitivities [A]",
    )


ARRAY = array_of(FEWEST + 2)
