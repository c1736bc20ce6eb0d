"""Links over which nothing can be written: a search must not change any device, whatever the code above does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn

from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.links.requests import only_reads
from palpate.instrument.errors import UsageError


class ReadOnlyModbus(ModbusLink):
    """A link that sends functions 1 to 4 and 43/14 alone, which change nothing. Raises UsageError for all others."""

    def transact(self, who: str, request: Callable[..., Any], *args: object, **timing: Any) -> Any:
        """As `ModbusLink.transact`."""
        if not only_reads(request):
            raise UsageError(f"{who}: a search only reads; {request.__name__} was not sent")
        return super().transact(who, request, *args, **timing)


class ReadOnlyCan(CanLink):
    """A CAN bus on which objects are read alone. Raises UsageError for all else that would be sent."""

    def download(self, who: str, *_: object) -> NoReturn:
        """Not sent."""
        raise UsageError(f"{who}: a search only reads; no object was written")

    def command(self, *_: object) -> NoReturn:
        """Not sent."""
        raise UsageError(f"{self.name}: a search only reads; no node was switched to another state")

    def _send(self, cob_id: int, data: bytes) -> NoReturn:
        """Not sent: neither process data nor a heartbeat."""
        raise UsageError(f"{self.name}: a search only reads; no frame {cob_id:03X}h was sent")

    def begin_cycle(self, cob_id: int, *_: object) -> NoReturn:
        """Not sent."""
        raise UsageError(f"{self.name}: a search only reads; no frame {cob_id:03X}h was sent")
