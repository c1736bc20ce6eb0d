"""What would lower the uncertainty of a modulus besides time on its object: a reference, more points of films."""

from __future__ import annotations

import math

from palpate.instrument.findings.mean_ratio import CALIBRATION
from palpate.procedures.engine.plan import MOUNTING
from palpate.procedures.measurements.object_modulus.lines import VALIDATION, Wanted
from palpate.procedures.measurements.object_modulus.prospect import Prospect
from palpate.procedures.measurements.object_modulus.refusal import REFERENCE_SECONDS
from palpate.procedures.measurements.object_modulus.telling import LEAST_SHARE
from palpate.procedures.measurements.repeated_sets import share
from palpate.procedures.showing.plan import duration


def worth_lines(wanted: Wanted, prospect: Prospect) -> list[str]:
    """What else pays, with the uncertainty that the plan would then have, for people; empty: nothing would lower it."""
    plan, found, lines = prospect.allocation, prospect.found, []
    references = found.references
    if not wanted.relative and references is not None and found.sensitivity is not None and VALIDATION in plan.shares:
        calibration = references.calibration
        more = calibration.with_more(len(calibration.references) + 1)
        if more is not None and more.u is not None:
            now = plan.shares[VALIDATION] * plan.u**2
            left = math.sqrt(plan.u**2 - now + (found.sensitivity * more.u) ** 2)
            lines.append(
                f"another        reference would give {share(left)}; it takes {duration(REFERENCE_SECONDS)}, once"
                f" (person {MOUNTING:g} s): palpate calibrate model"
            )
    if (films := plan.shares.get(CALIBRATION, 0.0)) >= LEAST_SHARE:
        lines.append(
            f"films          calibrated at twice as many points would give {share(plan.u * math.sqrt(1 - films / 2))}:"
            " palpate calibrate films"
        )
    return lines
