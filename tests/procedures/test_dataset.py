"""A recorded run as an xarray Dataset: points by sample and load, waveforms by time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.procedures.records.export import as_dataset
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from tests.procedures.conftest import HEADER


def recorded(folder: Path, rates: tuple[float, ...]) -> Run:
    """A point for each rate, the later the longer."""
    with Recorder.create(folder, HEADER) as record:
        for number, rate in enumerate(rates, 1):
            point = {
                "sample": str(number),
                "load_N": 1.5 * number,
                "force_ratio": 0.1 * number,
                "teeth": [{"tooth": 1}],
            }
            record.point(point, {"rigid": (rate, np.arange(10.0 * number))}, number)
        record.finish("complete", {})
    return Run.open(folder)


def test_points_have_sample_and_load_and_waveforms_their_time(tmp_path: Path) -> None:
    found = as_dataset(recorded(tmp_path, (250.0, 250.0)))
    second = found.set_index(point="load_N").sel(point=3.0)
    assert (second["sample"].item(), second.force_ratio.item()) == ("2", 0.2)
    assert found.time_s.values.tolist() == [index / 250 for index in range(20)]
    assert found.rigid.attrs == {"units": "V"}
    assert second.rigid.values.tolist() == list(range(20))
    assert np.isnan(found.rigid.values[0, 10:]).all()  # it is the shorter one
    assert found.attrs["simulated"] == "true"
    assert "teeth" not in found


def test_waveforms_of_several_rates_have_a_time_each(tmp_path: Path) -> None:
    found = as_dataset(recorded(tmp_path, (250.0, 500.0)))
    assert found.time_s.dims == ("point", "index")
    assert found.time_s.values[:, 5].tolist() == [5 / 250, 5 / 500]


def test_a_run_without_points_is_an_empty_dataset(tmp_path: Path) -> None:
    assert as_dataset(recorded(tmp_path, ())).sizes == {"point": 0}
