"""The rubber samples that the sensor touches, named by the thesis' numbers.

    parse_samples("1-3,6")          # ("1", "2", "3", "6")
    get_sample("2").modulus         # 24131.65 Pa

The moduli of samples 2 to 5 are the middle of a catalogue range; only 1 and 6 were measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from palpate.instrument.errors import RangeError, named, quoted


@dataclass(frozen=True, slots=True)
class Sample:
    """A sensed object: a flat pad of one material.

    Attributes:
        modulus: Young modulus [Pa].
        thickness: thickness of the pad [m].
        area: area of the loaded face [m2].
        poisson: Poisson ratio, above -1 and at most 0.5.
        source: where the numbers come from.

    Raises:
        RangeError: a dimension or the modulus is not positive and finite, or the Poisson ratio is outside its limits.
    """

    name: str
    material: str
    modulus: float
    thickness: float
    area: float
    poisson: float
    source: str

    def __post_init__(self) -> None:
        for label, value, unit in (
            ("modulus", self.modulus, "Pa"),
            ("thickness", self.thickness, "m"),
            ("area", self.area, "m2"),
        ):
            if not (0 < value < math.inf):
                raise RangeError(
                    f"{label} {value:g} {unit} of sample {self.name!r} is not above 0 and finite; give a positive one"
                )
        if not (-1 < self.poisson <= 0.5):
            raise RangeError(
                f"Poisson ratio {self.poisson:g} of sample {self.name!r} is not above -1 and at most 0.5;"
                " give one inside, 0.5 for an incompressible object"
            )


def _rubber(name: str, material: str, modulus: float, source: str) -> Sample:
    return Sample(
        name=name,
        material=material,
        modulus=modulus,
        thickness=3e-3,
        area=1e-4,
        poisson=0.3,
        source=f"modulus: [T] {source}; 3 mm and 1 cm2: [T] 5.4.1; Poisson ratio: [A]",
    )


SAMPLES: dict[str, Sample] = {
    sample.name: sample
    for sample in (
        _rubber("1", "white silicone rubber", 112609.9, "mean of Table 5.2"),
        _rubber("2", "Neoprene G-231-N", 24131.65, "5.3, 3.5 psi"),
        _rubber("3", "NBR/PVC/NEO blend SC-42", 41368.54, "5.3, 6 psi"),
        _rubber("4", "Natural 1523", 48263.30, "5.3, 7 psi; printed 4823.30, a digit lost"),
        _rubber("5", "NBR/PVC/NEO blend SC-41", 27579.03, "5.3, 4 psi; printed 2579.03, a digit lost"),
        _rubber("6", "unknown", 102667.3, "mean of Table 5.3, measured on a pad of 4.70 mm"),
    )
}


def get_sample(name: str) -> Sample:
    """The sample of that name.

    Raises:
        UnknownName: no such sample.
    """
    return named("sample", name, SAMPLES)


def parse_samples(text: str) -> tuple[str, ...]:
    """Names of samples in a text such as "1-6", "2" or "1,3,5-6", in the order of the text.

    Raises:
        UnknownName: there is no sample of that name.
        RangeError: a sample is named twice, or a range runs backwards or lacks an end.
    """
    names: list[str] = []
    for item in text.split(","):
        for name in _expand(item.strip()):
            if name in names:
                raise RangeError(f"sample {name!r} is named twice in {quoted(text)}; name each sample once")
            names.append(name)
    return tuple(names)


def _expand(item: str) -> Iterator[str]:
    first, dash, last = item.partition("-")
    if not dash:
        yield get_sample(item).name
        return
    if not first.strip() or not last.strip():
        raise RangeError(f"sample range {quoted(item)} lacks an end; write for example '1-3'")
    low, high = int(get_sample(first.strip()).name), int(get_sample(last.strip()).name)
    if low > high:
        raise RangeError(f"sample range {quoted(item)} runs backwards; write '{high}-{low}'")
    for number in range(low, high + 1):
        yield get_sample(str(number)).name
