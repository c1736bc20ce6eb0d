"""The order of the words of a reading, which many devices let their users choose: told by what the readings mean."""

from __future__ import annotations

import struct
from contextlib import suppress

from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import FLOATS, swapped
from palpate.instrument.errors import DeviceError

TINY = 1e-9  # of the unit of a display; a float of this size is no load
MOST_STEPS = 1e8  # of a display, that a float can tell: far more than a converter has
MOST_COUNTS = 1 << 24  # of an integer: a converter of 24 bits


class WordOrder:
    """Whether readings of one field come in the order of words that its map says, as far as they tell.

    A reading that would be no load in the order of the map is refused. One that would be no load in the other order
    tells that the order is right. Until there was one, a reading that could be a load in both orders is in doubt.

    Attributes:
        proved: whether the order is known to be right.
    """

    def __init__(self, contract: Contract, name: str, step: float) -> None:
        """Nothing is told yet.

        Args:
            contract: the device's contract.
            name: the field.
            step: step of the display, in the field's unit.
        """
        self._contract, self._field, self._step = contract, contract[name], step
        several = contract.bus == "modbus" and self._field.width > 1
        self.proved = not several or _proved(contract, name)

    def doubt(self, value: float, beside: dict[str, float], device: str) -> str:
        """Why it is not known that a reading is right; empty: it is known, or the reading is the same in both orders.

        Args:
            value: the reading, a number.
            beside: what the device tells of its scale.
            device: name of the device, for messages.

        Raises DeviceError: it is no load.
        """
        f = self._field
        read = f"{device}: {f.name} reads {value:.6g} {f.unit}".rstrip()
        other = self._otherwise(value, beside)
        if not self._can_be(value, beside):
            remedy = (
                f"so its words come in the other order ({other:.6g} {f.unit}".rstrip()
                + "); set the device to the order of its map, or use a map for its order"
                if other is not None
                else "which is no load; check type, address and scale of the field in its map, and the display's "
                "resolution"
            )
            raise DeviceError(
                f"{read}, {remedy}. If it says that there is no reading, give it as `missing`", device=device
            )
        if self.proved or value in (0, other):
            return ""
        if other is None:
            self.proved = True
            return ""
        return (
            f"{read}, with its words in the other order {other:.6g} {f.unit}".rstrip()
            + ": which is right is not told yet; compare with the display, or change the load until a reading tells"
        )

    def _can_be(self, value: float, beside: dict[str, float]) -> bool:
        """Whether a value can be a load."""
        f = self._field
        if value == 0:
            return True
        if self._contract.misread(f.name, value):
            return False
        if f.type in FLOATS:
            return TINY <= abs(value) <= MOST_STEPS * self._step
        return abs(value - f.offset) <= MOST_COUNTS * abs(self._contract.step(f.name, beside))

    def _otherwise(self, value: float, beside: dict[str, float]) -> float | None:
        """The load in the other order of words; None: in this order there is none."""
        name = self._field.name
        signs = {self._field.sign[0]: 0.0} if self._field.sign else {}
        with suppress(struct.error, OverflowError, ValueError):
            data = swapped(self._contract.pack(name, value, beside), words=True, octets=False)
            found = self._contract.decode(name, data, beside | signs)
            return found if found == found and self._can_be(found, beside) else None
        return None


def _proved(contract: Contract, name: str) -> bool:
    """Whether a device is known by a number of several words in the same order, which reads otherwise in another."""
    words = contract[name].words
    if contract.has("probe") and contract["probe"].words == words:
        return True
    for mark in contract.marks:
        f = contract[mark.field]
        if f.type != "text" and f.width > 1 and f.words == words:
            data = contract.encode(f.name, mark.value)
            if data != swapped(data, words=True, octets=False):
                return True
    return False
