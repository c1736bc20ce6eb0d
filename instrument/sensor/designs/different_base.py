"""Two teeth on a base each, side by side: the second array of section 3.2 of the thesis."""

from __future__ import annotations

from palpate.instrument.sensor.design import Design, Film, FilmSheet, Plate
from palpate.instrument.sensor.designs.single import SINGLE
from palpate.instrument.sensor.film_material import PVDF
from palpate.instrument.sensor.material import PLEXIGLAS_THESIS

DIFFERENT_BASE = Design(
    name="different_base",
    tooth=SINGLE.tooth,
    ring=SINGLE.ring,
    # 3.2.1 gives 12 x 24 mm for the pair; [A] half of it each.
    plate=Plate(length=12e-3, width=12e-3, thickness=0.55e-3, material=PLEXIGLAS_THESIS),
    plate_count=2,
    teeth=((6e-3, 6e-3), (18e-3, 6e-3)),  # [A] each in the middle of its base
    separate_bases=True,
    film_sheet=FilmSheet(disc_radius=1.4e-3, length=12e-3, width=12e-3, thickness=25e-6, material=PVDF),
    films=(
        # Means and standard deviations of voltage over force in the six rows of Table 5.7, all at 3 N.
        Film(name="rigid_1", channel=1, sensitivity=5.675e-3, scatter=0.056, teeth=(0,)),
        Film(name="total_1", channel=2, sensitivity=63.66e-3, scatter=0.049, teeth=(0,)),
        Film(name="rigid_2", channel=3, sensitivity=5.692e-3, scatter=0.081, teeth=(1,)),
        Film(name="total_2", channel=4, sensitivity=64.21e-3, scatter=0.021, teeth=(1,)),
    ),
    # [A] Each tooth and its base are as a single sensor, independent of the other: the thesis has one load only.
    scatter_correlation={
        (f"rigid_{tooth}", f"total_{tooth}"): SINGLE.scatter_correlation["rigid", "total"] for tooth in (1, 2)
    },
    thesis_force_ratio={"1": 0.348, "2": 0.127, "3": 0.189, "4": 0.246, "5": 0.170, "6": 0.287},  # Table 5.7, 3 N
    thesis_softness_order=("1", "6", "4", "3", "5", "2"),  # Figure 5.5
    source="[T] 3.2.1, Table 5.7, Figure 5.5",
)
