"""The gauge does what every device must do."""

from pathlib import Path

from palpate.testing import GoldenFrames, OnTheBench, RtuConformance


class TestGauge(GoldenFrames, OnTheBench, RtuConformance):
    kind = "acme-gauge"
    golden = Path(__file__).with_name("gauge.toml")

    def test_an_unloaded_cell_reads_nothing(self, device):
        device.clear_tare()
        device.track(0.1)
        device.clock.wait(1.0)
        assert device.read().valid
        assert device.read().reading_mV == 0.0
