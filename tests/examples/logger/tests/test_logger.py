"""The logger does what every device must do."""

import numpy as np

from palpate.testing import ModbusConformance, OnTheBench


class TestLogger(OnTheBench, ModbusConformance):
    kind = "acme-logger"

    def test_what_it_records_are_the_films(self, device, simulated):
        device.set_sample_rate(1000.0)
        for channel in range(1, 5):
            device.set_range(channel, "1 V")
        (recording,) = device.acquire_with([], 0.05)
        films = simulated.rig.film_voltages(simulated.began_ns + 1_000_000 * np.arange(1, 51))
        assert np.allclose(recording.voltage[: len(films)], films, atol=device.resolution(1))
