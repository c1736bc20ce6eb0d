"""Who owns the simulated amplifier, and when its watchdog was fed."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from palpate.simulators.wire.device import DEVICE_BUSY, ILLEGAL_VALUE, Refused

TICKETS = 64  # of the last ones any may be used: more than the clients that are let in
SPREAD = 2_654_435_761  # odd, so that no ticket comes twice; neighbours differ in many bits


class Owner:
    """Whoever has claimed the amplifier by a ticket, until he releases it or another claims it.

    Attributes:
        token: the owner's ticket; 0: there is no owner.
        fed_ns: when the watchdog was last fed, on the bench's clock.
    """

    def __init__(self) -> None:
        self.token = 0
        self.fed_ns = 0
        self._counters = {False: 0, True: 0}  # of signs of life, and of orders
        self._given = 0
        self._tickets: deque[int] = deque(maxlen=TICKETS)

    def ticket(self) -> int:
        """A number that was not given before. Each run gives the same numbers in the same order."""
        self._given += 1
        ticket = self._given * SPREAD % 2**32
        self._tickets.append(ticket)
        return ticket

    def heard(self, values: Mapping[str, float], now_ns: int, lease_ns: int) -> None:
        """The owner feeds the watchdog, or somebody becomes the owner by a ticket.

        Raises Refused: no counter, or not a new one; another owner is alive; no ticket, or a used one.
        """
        if "counter" not in values or ("order" in values) != ("order_value" in values):
            raise Refused(ILLEGAL_VALUE)
        token, counter, series = int(values["token"]), int(values["counter"]), "order" in values
        if token != self.token:
            if self._alive(now_ns, lease_ns):
                raise Refused(DEVICE_BUSY)
            if token not in self._tickets:
                raise Refused(ILLEGAL_VALUE)
            self._tickets.remove(token)
            self.token, self._counters = token, {False: 0, True: 0}
        elif counter <= self._counters[series]:
            raise Refused(ILLEGAL_VALUE)
        self._counters[series], self.fed_ns = counter, now_ns

    def replaced(self, now_ns: int, lease_ns: int) -> None:
        """Somebody who has not claimed it writes a setting. Raises Refused: its owner is alive."""
        if self._alive(now_ns, lease_ns):
            raise Refused(DEVICE_BUSY)
        if self.token:
            self.token, self.fed_ns = 0, now_ns

    def release(self, token: float) -> None:
        """Nobody owns it from now on. Raises Refused: it is not his to release."""
        if int(token) != self.token:
            raise Refused(DEVICE_BUSY)
        self.token = 0

    def forget(self) -> None:
        """As after power-on."""
        self.token = 0
        self._tickets.clear()

    def _alive(self, now_ns: int, lease_ns: int) -> bool:
        return bool(self.token) and now_ns < self.fed_ns + lease_ns
