"""The sensor designs, by name: ours, and those of installed packages.

[project.entry-points."palpate.designs"]
grasper_7 = "grasper_7:DESIGN"
"""

from __future__ import annotations

from dataclasses import replace

from palpate.instrument.additions import find, unusable
from palpate.instrument.errors import RangeError
from palpate.instrument.sensor.design import THESIS_LOADS, Design, Film, FilmSheet, Plate, Ring, Tooth
from palpate.instrument.sensor.material import NEOPRENE_RING, PHENOLIC, PLEXIGLAS_THESIS, PVDF

# --- one tooth -----------------------------------------------------------------------------------------


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


# --- one tooth on discs --------------------------------------------------------------------------------


SINGLE_ROUND = replace(
    SINGLE,
    name="single_round",
    outline="round",
    thesis_force_ratio={},  # None: the thesis measured the square sensor only
    thesis_softness_order=(),
    source="[A] the single sensor's dimensions and materials, its squares of 10 mm replaced by discs of radius 5 mm",
)


# --- two teeth on one base -----------------------------------------------------------------------------


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


# --- two teeth on a base each --------------------------------------------------------------------------


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


# --- an array ------------------------------------------------------------------------------------------


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


# --- all of them, by name ------------------------------------------------------------------------------


DESIGNS: dict[str, Design] = {
    design.name: design for design in (SINGLE, SINGLE_ROUND, COMMON_BASE, DIFFERENT_BASE, ARRAY, array_of(16))
}

GROUP, WHAT = "palpate.designs", "design"


def get_design(name: str) -> Design:
    """The design of that name.

    Raises:
        UnknownName: there is no design of that name.
        ConfigError: the package that adds it cannot be used.
    """
    if name in DESIGNS:
        return DESIGNS[name]
    found, design = find(GROUP, WHAT, name, DESIGNS)
    if not isinstance(design, Design) or design.name != name:
        raise unusable(found, WHAT, f"is no Design that is called {name!r}")
    return design
