"""Makers' EDS and DCF files, of folders that PALPATE_EDS names, held against a second reader of CiA 306.

The files belong to their makers, and are in no repository.
"""

from __future__ import annotations

from palpate.instrument.contracts.maps.eds import FOLDERS, folders
from tests.benchmarks.row import Row
from tests.second_reader import hold

SUFFIXES = (".eds", ".dcf")
SHOWN = 5  # faults of each kind
WANTED = 100  # files


def measure() -> list[Row]:
    files = [path for folder in folders() for path in sorted(folder.iterdir()) if path.suffix.lower() in SUFFIXES]
    if not files:
        return [Row(f"makers' EDS and DCF: {FOLDERS} names no folder with any", "not measured", f"{WANTED} files")]
    held = [hold(path) for path in files]
    objects, pdos = sum(each.objects for each in held), sum(each.pdos for each in held)
    counted = f"{len(files)}, {objects} objects, {pdos} PDOs"
    rows = [Row("makers' EDS and DCF", counted, f"{WANTED} files", len(files) >= WANTED)]
    for what, faults in (
        ("wrong", [fault for each in held for fault in each.wrong]),
        ("lost without a note", [fault for each in held for fault in each.lost]),
        ("refused wrongly", [fault for each in held for fault in each.refused]),
    ):
        shown = "; ".join(faults[:SHOWN])
        rows.append(Row(f"of these, {what}", f"{len(faults)}" + (f" ({shown})" if shown else ""), "0", not faults))
    return rows
