"""The client's end of SDO transfers (CiA 301): it finds the answer that belongs to a request."""

from __future__ import annotations

import itertools
import queue
import time

from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from palpate.instrument.bench.links import Stepper

LATE_ANSWERS = 10  # greatest number that an interrupted transfer can leave; a node that sends more is not trusted
LARGEST_OBJECT = 4096  # bytes; a device name has some tens
SEGMENT = 7  # bytes of an object in a frame
FRAME = 8  # bytes
SPECIFIER, TOGGLE = 0xE0, 0x10  # bits of a command
DOWNLOAD, UPLOAD, UPLOAD_SEGMENT, DOWNLOAD_SEGMENT, ABORT = 0x20, 0x40, 0x60, 0x00, 0x80
ANSWERS = {DOWNLOAD: 0x60, UPLOAD: 0x40, UPLOAD_SEGMENT: 0x00, DOWNLOAD_SEGMENT: 0x20}
TIMED_OUT = 0x0504_0000
NO_OBJECT = bytes(3)


class CheckedSdoClient(SdoClient):
    """SDO client that checks answers; canopen's own takes the first answer that comes, of any length.

    Answers have no number. A late or repeated answer is known by its object, by its toggle bit, or because it came
    before request and answer could have been on the bus; it is skipped. The frames of a text do not name their object,
    so a text is read twice, and both readings must agree.

    Attributes:
        shortest: shortest time that request and answer take on the bus [s]; 0 where there is no wire.
        too_soon: number of answers to the last request that came sooner.
        stepper: see `palpate.drivers.clock.BenchClock`.
    """

    shortest = 0.0
    too_soon = 0
    stepper: Stepper | None = None
    _object = NO_OBJECT  # index and subindex of the transfer

    def on_response(self, can_id: int, data: bytearray, timestamp: float) -> None:
        if len(data) == FRAME and self.responses.qsize() <= LATE_ANSWERS:
            super().on_response(can_id, data, timestamp)  # type: ignore[no-untyped-call]

    def request_response(self, sdo_request: bytearray) -> bytes:
        """Send a request and return its answer. Raises SdoCommunicationError: none came in time; SdoAbortedError."""
        request = bytes(sdo_request)
        if request[0] & SPECIFIER in (DOWNLOAD, UPLOAD):
            self._object = request[1:4]
        self._forget()
        self.too_soon = 0
        earliest = self.now() + self.shortest
        self.send_request(request)  # type: ignore[no-untyped-call]
        until = self.now() + self.RESPONSE_TIMEOUT
        for heard in itertools.count():
            left = max(until - self.now(), 0.0)
            if not left and heard > LATE_ANSWERS:
                break
            try:
                answer = self.next_answer(left)
            except queue.Empty:
                break
            if self.now() < earliest:
                self.too_soon += 1
                continue
            if answer[0] == ABORT and answer[1:4] in (self._object, NO_OBJECT):
                raise SdoAbortedError(int.from_bytes(answer[4:], "little"))
            if self._answers(answer, request):
                return answer
        self.abort(TIMED_OUT)  # type: ignore[no-untyped-call]
        raise SdoCommunicationError("no answer in time")

    def next_answer(self, within: float) -> bytes:
        """The next answer of the node, to whatever request. Raises queue.Empty: none comes for so long [s]."""
        if self.stepper is not None:
            until = self.now() + within
            self.stepper.step()
            while self.responses.empty() and (left := until - self.now()) > 0:
                self.stepper.glance(left)
            within = 0.0
        answer: bytes = self.responses.get(timeout=within)
        return answer

    def _answers(self, answer: bytes, request: bytes) -> bool:
        asked = request[0] & SPECIFIER
        if answer[0] & SPECIFIER != ANSWERS.get(asked):
            return False
        if asked in (DOWNLOAD, UPLOAD):
            return answer[1:4] == self._object
        return answer[0] & TOGGLE == request[0] & TOGGLE

    def _forget(self) -> None:
        """Throw away answers that came before they were asked for."""
        while not self.responses.empty():
            self.responses.get()

    def now(self) -> float:
        """Time by which answers are late or too soon [s]."""
        return time.monotonic()

    def upload(self, index: int, subindex: int, size: int | None = None) -> bytes:
        """Read an object, which must have the announced size; without one, the first `size` of its four bytes.

        Raises:
            SdoCommunicationError: the object has another size or no end, or its frames differ when they are read again.
            SdoAbortedError: the node refuses.
        """
        data, in_segments = self._read(index, subindex, size)
        if in_segments and self._read(index, subindex, size)[0] != data:
            raise SdoCommunicationError("two reads of the object gave different values")
        return data

    def _read(self, index: int, subindex: int, size: int | None) -> tuple[bytes, bool]:
        """An object, and whether it came in segments."""
        with self.open(index, subindex, "rb", buffering=0) as stream:  # type: ignore[no-untyped-call]
            segments = list(itertools.islice(iter(lambda: stream.read(SEGMENT), b""), LARGEST_OBJECT // SEGMENT))
            data = b"".join(segments)
            if not stream._done or stream.size not in (None, len(data)):
                raise SdoCommunicationError(f"object of {len(data)} bytes, {stream.size} were announced")
            unsaid = stream.exp_data is not None and stream.size is None
            in_segments = stream.exp_data is None
        return data[:size] if unsaid else data, in_segments
