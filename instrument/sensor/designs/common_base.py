"""Two teeth on one base of 24 x 12 mm: the first array of section 3.2 of the thesis."""

from __future__ import annotations

from palpate.instrument.sensor.design import THESIS_LOADS, Design, Film, FilmSheet, Plate
from palpate.instrument.sensor.designs.single import SINGLE
from palpate.instrument.sensor.film_material import PVDF
from palpate.instrument.sensor.material import PLEXIGLAS_THESIS

COMMON_BASE = Design(
    name="common_base",
    tooth=SINGLE.tooth,
    ring=SINGLE.ring,
    plate=Plate(length=24e-3, width=12e-3, thickness=0.55e-3, material=PLEXIGLAS_THESIS),  # 5.4.2
    plate_count=2,
    teeth=((6e-3, 6e-3), (18e-3, 6e-3)),  # [A] each in the middle of its half, where Table A2.7 peaks
    film_sheet=FilmSheet(disc_radius=1.4e-3, length=24e-3, width=12e-3, thickness=25e-6, material=PVDF),
    films=(
        # Means and standard deviations of voltage over force in the 42 rows of Tables A2.15 to A2.20.
        Film(name="rigid_1", channel=1, sensitivity=7.013e-3, scatter=0.125, teeth=(0,)),
        Film(name="rigid_2", channel=2, sensitivity=6.506e-3, scatter=0.095, teeth=(1,)),
        Film(name="total", channel=3, sensitivity=23.53e-3, scatter=0.066, teeth=(0, 1)),
    ),
    # In these rows 0.07, 0.70 and 0.39. 0.67 and 0.38 let the ratio repeat to 5.5 %, as the tables' own does.
    scatter_correlation={("rigid_1", "rigid_2"): 0.07, ("rigid_1", "total"): 0.67, ("rigid_2", "total"): 0.38},
    # Printed averages of Tables A2.15 to A2.20; scaled copies of the single sensor's rows, no second experiment.
    thesis_force_ratio={"1": 0.287, "2": 0.131, "3": 0.164, "4": 0.195, "5": 0.155, "6": 0.260},
    thesis_softness_order=("1", "6", "4", "5", "3", "2"),  # Figure 5.4, at 3 N
    thesis_loads=(*THESIS_LOADS, 4.5),
    source="[T] 3.2.2, 5.4.2, Tables A2.15 to A2.20, Figure 5.4",
)
