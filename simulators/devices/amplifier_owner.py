"""The simulated amplifier's owner: the client that alone may write settings, and that feeds the watchdog."""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Mapping

from palpate.simulators.wire.device import DEVICE_BUSY, ILLEGAL_VALUE, Refused

TICKETS = 64  # number of unused tickets that stay valid: more than the clients that a server accepts
SPREAD = 2_654_435_761  # of tickets that anybody can guess: odd, so that none repeats, and they differ in many bits


class AmplifierOwner:
    """Keeps which client owns the amplifier: the one that has claimed it with a ticket, until it releases it.

    Attributes:
        token: the owner's ticket; 0: there is no owner.
        fed_ns: time of the last sign of life that fed the watchdog, on the bench's clock [ns].
    """

    def __init__(self) -> None:
        self.token = 0
        self.fed_ns = 0
        self._counters = {False: 0, True: 0}  # the last counter of a sign of life, and of an order (True)
        self._given = 0
        self._tickets: deque[int] = deque(maxlen=TICKETS)

    def ticket(self, *, secret: bool) -> int:
        """A new ticket, not 0. One that is not `secret` differs from all before it, and is the same in each run."""
        self._given += 1
        ticket = 1 + secrets.randbelow(2**32 - 1) if secret else self._given * SPREAD % 2**32
        self._tickets.append(ticket)
        return ticket

    def heard(self, values: Mapping[str, float], now_ns: int, lease_ns: int) -> None:
        """Handle a write with a token: a sign of life from the owner, or a claim with a new ticket.

        Args:
            values: the written fields, with the token.
            now_ns: the time on the bench's clock [ns].
            lease_ns: how long an owner counts as alive after its last sign of life [ns].

        Raises Refused: the counter is missing or not greater than the last; another owner is alive; the token is no
            valid ticket, or a used one.
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
        """Handle a write without a token, which ends a dead owner's claim. Raises Refused: the owner is alive."""
        if self._alive(now_ns, lease_ns):
            raise Refused(DEVICE_BUSY)
        if self.token:
            self.token, self.fed_ns = 0, now_ns

    def release(self, token: float) -> None:
        """End the owner's claim. Raises Refused: the token is not the owner's."""
        if int(token) != self.token:
            raise Refused(DEVICE_BUSY)
        self.token = 0

    def forget(self) -> None:
        """Return to the state after power-on."""
        self.token = 0
        self._tickets.clear()

    def _alive(self, now_ns: int, lease_ns: int) -> bool:
        return bool(self.token) and now_ns < self.fed_ns + lease_ns
