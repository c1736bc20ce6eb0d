"""The state machine of a drive (CiA 402-2): what its controlword asks for, and what its statusword tells."""

from __future__ import annotations

DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOPPING, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x08
OF_THE_STATE = 0x6F  # bits of the statusword that tell the state
RESET = 0x80  # bit of the controlword
STAYING = 5  # the least option code of a quick stop (605Ah) with which a drive stays in that state


class DriveState:
    """State of a drive, as the bits of its statusword.

    Attributes:
        bits: the state.
    """

    def __init__(self) -> None:
        self.bits = DISABLED
        self._last = 0

    @property
    def enabled(self) -> bool:
        return self.bits == ENABLED

    def control(self, word: int, quick_stop: int) -> None:
        """Take a controlword; one that the present state does not know changes nothing.

        Args:
            word: the controlword.
            quick_stop: option code of a quick stop (605Ah): with 5 or more the drive stays in that state, with less it
                is disabled once it stands still.
        """
        rising = word & ~self._last
        self._last = word
        if self.bits == FAULT:
            if rising & RESET:
                self.bits = DISABLED
        elif not word & 0x02:  # disable voltage
            self.bits = DISABLED
        elif not word & 0x04:  # quick stop
            self.bits = QUICK_STOPPING if self.enabled and quick_stop >= STAYING else DISABLED
        elif word & 0x0F == 0x06:  # shutdown
            self.bits = READY if self.bits != QUICK_STOPPING else self.bits
        elif word & 0x0F == 0x07 and self.bits in (READY, ENABLED):  # switch on, disable operation
            self.bits = SWITCHED_ON
        elif word & 0x0F == 0x0F and self.bits in (READY, SWITCHED_ON):  # enable operation
            self.bits = ENABLED

    def fail(self) -> None:
        """Go to the state of a fault, which stays until it is reset."""
        self.bits = FAULT
