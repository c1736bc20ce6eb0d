"""What a simulated device has been told to write."""

from __future__ import annotations

from palpate.simulators.wire.device import SimulatedDevice


def counted_writes(device: SimulatedDevice) -> list[dict[str, float]]:
    """The writes that reach a device from now on, as they come."""
    writes: list[dict[str, float]] = []
    write = device.write

    def counted(values: dict[str, float]) -> None:
        writes.append(values)
        write(values)

    device.write = counted  # type: ignore[method-assign]
    return writes
