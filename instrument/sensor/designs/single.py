"""One tooth on one base of 10 x 10 mm: the sensor of section 3.1 of the thesis."""

from __future__ import annotations

from palpate.instrument.sensor.design import Design, Film, FilmSheet, Plate, Ring, Tooth
from palpate.instrument.sensor.film_material import PVDF
from palpate.instrument.sensor.material import NEOPRENE_RING, PHENOLIC, PLEXIGLAS_THESIS

SINGLE = Design(
    name="single",
    tooth=Tooth(radius=1.4e-3, height=3.88e-3, material=PHENOLIC),  # 3.1.3
    ring=Ring(  # 3.1.4; the text says diameter, its symbols and the areas of A2.1 say radius
        inner_radius=1.5e-3, outer_radius=5e-3, height=3.88e-3, material=NEOPRENE_RING
    ),
    plate=Plate(length=10e-3, width=10e-3, thickness=0.55e-3, material=PLEXIGLAS_THESIS),  # Table 3.1
    plate_count=2,
    film_sheet=FilmSheet(  # 3.1.2; Figure 3.1 prints 23 µm
        disc_radius=1.4e-3, length=10e-3, width=10e-3, thickness=25e-6, material=PVDF
    ),
    films=(
        # Means and standard deviations of voltage over force in the 36 rows of Tables A2.9 to A2.14.
        Film(name="rigid", channel=1, sensitivity=5.995e-3, scatter=0.033),
        Film(name="total", channel=2, sensitivity=68.60e-3, scatter=0.030),
    ),
    scatter_correlation={("rigid", "total"): 0.156},  # by it the ratio repeats to 4.1 %, as in Tables A2.9 to A2.14
    # Printed averages of Tables A2.9 to A2.14.
    thesis_force_ratio={"1": 0.314, "2": 0.142, "3": 0.183, "4": 0.218, "5": 0.165, "6": 0.276},
    thesis_softness_order=("1", "6", "4", "3", "5", "2"),  # Figure 5.3
    source="[T] 3.1, Tables 3.1, 3.2, A2.9 to A2.14, Figure 5.3",
)
