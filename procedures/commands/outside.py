"""Says which installed package's code raised an error that is none of palpate's."""

from __future__ import annotations

import traceback
from pathlib import Path


def blamed(error: BaseException) -> str:
    """What failed in the code of an installed package, for people; empty if no such code was running.

    It names the package, the function that palpate called, the error, and the line of the package where it came up.
    """
    from palpate.instrument.additions import additions
    from palpate.instrument.bench.kinds import GROUP as KINDS
    from palpate.instrument.sensor.designs import GROUP as DESIGNS
    from palpate.procedures.engine.catalogue import GROUP as PROCEDURES
    from palpate.procedures.virtual.explained import GROUP as EFFECTS

    origins = {
        each.place.partition(":")[0].partition(".")[0]: each.origin
        for group in (PROCEDURES, KINDS, EFFECTS, DESIGNS)
        for several in additions(group).values()
        for each in several
    }
    frames = [
        (origins[module], frame.f_code, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if (module := str(frame.f_globals.get("__name__")).partition(".")[0]) in origins and module != "palpate"
    ]
    if not frames:
        return ""
    (origin, hook, _), (_, code, line) = frames[0], frames[-1]
    return (
        f"{origin}: {hook.co_qualname} failed: {type(error).__name__}: {error} ({Path(code.co_filename).name}, line"
        f" {line}); mend that package"
    )
