"""Types that a script outside may rely on: held by a strict check against the installed wheel."""

import pandas as pd
from relaxation import Reading, Relaxation

import palpate
from palpate.extend import Response, SimpleResult

with palpate.open_bench(scene="thesis_single") as bench:
    done: palpate.Finished[SimpleResult[Reading]] = palpate.run(Relaxation(readings=2), bench)
    sweep = palpate.run(palpate.LoadSweep(samples=("1", "2"), loads=(2.0,), dwell=0.2), bench)
order: list[str] = sweep.result.softness_order
table: pd.DataFrame = sweep.run.table()
load: palpate.Load = palpate.Load(force=2.0, sensed=palpate.get_sample("2"))
answer: Response = palpate.response(palpate.get_design("single"), load, model="column_fitted")
ratio: float = answer.force_ratio
assert order == ["1", "2"] == list(table["sample"])
assert 0 < ratio < 1
assert sweep.plot() is not None
assert done.plot() is None
