"""The oven does what every device must do."""

from pathlib import Path

from palpate.testing import GoldenFrames, ModbusConformance, OnTheBench


class TestOven(GoldenFrames, OnTheBench, ModbusConformance):
    kind = "acme-oven"
    golden = Path(__file__).with_name("oven.toml")

    def test_it_is_as_warm_as_it_is_asked_to_be(self, device):
        device.warm(12.5)
        assert device.temperature() == 32.5
        device.warm(0)
        assert device.temperature() == 20.0
        device.warm(12.5)
        device.off()
        assert device.temperature() == 20.0
