"""A recorded run as an xarray Dataset: points by sample and load, waveforms by time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.instrument.errors import UsageError
from palpate.procedures.engine.dataset import as_dataset
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


def test_waveforms_of_one_point_with_several_rates_have_a_time_each(tmp_path: Path) -> None:
    with Recorder.create(tmp_path, HEADER) as record:
        record.point({}, {"film": (250.0, np.arange(4.0)), "load": (10.0, np.arange(3.0))}, 1)
        record.point({}, {"film": (500.0, np.arange(4.0)), "load": (10.0, np.arange(3.0))}, 2)
    found = as_dataset(Run.open(tmp_path))
    assert "time_s" not in found.coords
    assert found.load_time_s.values.tolist() == [0.0, 0.1, 0.2, 0.3]
    assert found.film_time_s.dims == ("point", "index")
    assert found.film_time_s.values[:, 3].tolist() == [3 / 250, 3 / 500]


@pytest.mark.parametrize(
    ("value", "waveform"),
    [("x", "x"), *(pair for name in ("point", "time_s", "index") for pair in ((name, "film"), ("x", name)))],
)
def test_a_waveform_or_a_value_does_not_take_the_place_of_another(tmp_path: Path, value: str, waveform: str) -> None:
    with Recorder.create(tmp_path, HEADER) as record:
        record.point({value: 1.0, "sample": "1"}, {waveform: (250.0, np.arange(4.0))}, 1)
    name = value if waveform == "film" else waveform
    told = f"two of its values, waveforms, dimensions and times are called '{name}'; .* palpate runs export"
    with pytest.raises(UsageError, match=told):
        as_dataset(Run.open(tmp_path))


def test_a_run_without_points_is_an_empty_dataset(tmp_path: Path) -> None:
    assert as_dataset(recorded(tmp_path, ())).sizes == {"point": 0}
