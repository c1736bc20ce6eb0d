"""What a softness test is expected to give: the mean force ratio of each object, and its modulus by the model.

Ratios are the thesis' means [M]; for other objects they are those of the model that answers, at the object's modulus.
The uncertainty of a modulus is that of `estimate` for the expected mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from palpate.instrument.findings.object_modulus import ByReferences, estimate
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.sensor.design import Design
from palpate.procedures.engine.promise import Expected
from palpate.procedures.measurements.prospects import expected_mean


def expected_moduli(
    design: Design,
    ratios: Mapping[str, float],
    loads: Mapping[str, Sequence[float]],
    dwell: float,
    question: RatioQuestion | None,
    references: ByReferences | None = None,
) -> list[Expected]:
    """Relative uncertainties of the mean ratio and of the modulus of each object, on the model's scale and absolute.

    Args:
        design: design of the sensor.
        ratios: expected force ratio of each object, by its name.
        loads: load of each load set of each object, peak to peak [N].
        dwell: dwell of each [s].
        question: what the model is asked; None: it takes too long to answer beforehand.
        references: the model's calibration by references; None: there is none.
    """
    means = {
        name: expected_mean(f"force ratio of {name}", design, ratio, loads[name], [dwell] * len(loads[name]))
        for name, ratio in ratios.items()
    }
    found = [Expected.of(mean) for mean in means.values()]
    if question is None:
        return found
    values, us, freedom = zip(*((m.value, m.u, m.degrees_of_freedom) for m in means.values()), strict=True)
    rows = estimate(question, values, us, freedom, references)
    for name, row in zip(means, rows, strict=True):
        for told in ("scale", "absolute"):
            if row["modulus_Pa"] is not None and row[f"{told}_u"] is not None:
                found.append(Expected(f"modulus of {name}, {told}", row[f"{told}_u"]))
    return found
