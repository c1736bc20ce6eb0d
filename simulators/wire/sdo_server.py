"""canopen's SDO server, corrected where it does not follow CiA 301.

canopen's own server takes four bytes if a client does not say how many of them are valid, collects segments without a
limit, answers segments that belong to no transfer, and answers a block upload in a way that the client did not offer.
"""

from __future__ import annotations

import struct

from canopen.objectdictionary import ODVariable
from canopen.sdo.exceptions import SdoAbortedError
from canopen.sdo.server import SdoServer as CanopenSdoServer

EXPEDITED, SIZED, SUBCOMMAND = 2, 1, 3  # bits of a command byte
NOT_TOGGLED, UNKNOWN_COMMAND = 0x0503_0000, 0x0504_0001
NOT_WRITABLE = 0x0601_0002
DATA_TOO_LONG, DATA_TOO_SHORT = 0x0607_0012, 0x0607_0013
WORDS = struct.Struct("<BHB")  # command, index, subindex
ANY = 4  # most data bytes of an expedited transfer
LONGEST_TEXT = 1000  # bytes


class SdoServer(CanopenSdoServer):
    """Serves one transfer at a time, and refuses segments that belong to no transfer."""

    _begun = ""  # the transfer whose segments may come: "upload", "download", or none

    def abort(self, abort_code: int = 0x0800_0000) -> None:
        self._begun = ""
        super().abort(abort_code)  # type: ignore[no-untyped-call]

    def request_aborted(self, data: bytearray) -> None:
        self._begun = ""
        super().request_aborted(data)  # type: ignore[no-untyped-call]

    def init_upload(self, request: bytearray) -> None:
        self._begun = ""
        self._buffer = bytearray()
        super().init_upload(request)  # type: ignore[no-untyped-call]
        self._begun = "upload" if self._buffer else ""

    def segmented_upload(self, command: int) -> None:
        self._check_segment("upload", command)
        super().segmented_upload(command)  # type: ignore[no-untyped-call]
        self._begun = "upload" if self._buffer else ""

    def init_download(self, request: bytearray) -> None:
        """Begin a download, or refuse at once one whose announced size does not fit the object."""
        command, index, subindex = WORDS.unpack_from(request)
        self._index, self._subindex, self._begun = index, subindex, ""
        least, most = self._writable_sizes(index, subindex)
        if command & EXPEDITED and not command & SIZED:
            request = bytearray(request)
            request[0] |= SIZED | (ANY - min(most, ANY)) << 2
        elif command & SIZED and not command & EXPEDITED:
            (announced,) = struct.unpack_from("<L", request, 4)
            if not least <= announced <= most:
                raise SdoAbortedError(DATA_TOO_LONG if announced > most else DATA_TOO_SHORT)
        super().init_download(request)  # type: ignore[no-untyped-call]
        self._begun, self._most = "" if command & EXPEDITED else "download", most

    def segmented_download(self, command: int, request: bytearray) -> None:
        self._check_segment("download", command)
        if len(self._buffer or b"") + 7 - (command >> 1 & 7) > self._most:
            raise SdoAbortedError(DATA_TOO_LONG)
        super().segmented_download(command, request)  # type: ignore[no-untyped-call]
        self._begun = "" if command & 1 else "download"

    def block_upload(self, data: bytearray) -> None:
        """Answer with an ordinary upload if the client allows that for an object of this size; else refuse."""
        _, self._index, self._subindex = WORDS.unpack_from(data)
        offered = data[5]  # the protocol switch threshold [bytes]; 0: the client allows no ordinary upload
        if data[0] & SUBCOMMAND or not offered:
            raise SdoAbortedError(UNKNOWN_COMMAND)
        if len(self._node.get_data(self._index, self._subindex, check_readable=True)) > offered:
            raise SdoAbortedError(UNKNOWN_COMMAND)
        self.init_upload(data)

    def _check_segment(self, way: str, command: int) -> None:
        if self._begun != way:
            raise SdoAbortedError(UNKNOWN_COMMAND)
        if command & 0x10 != self._toggle:
            raise SdoAbortedError(NOT_TOGGLED)

    def _writable_sizes(self, index: int, subindex: int) -> tuple[int, int]:
        """Least and most bytes that a write of an object may have. Raises SdoAbortedError: it is not writable."""
        found: ODVariable = self._node._find_object(index, subindex)
        if not found.writable:
            raise SdoAbortedError(NOT_WRITABLE)
        size = len(found) // 8
        return (size, size) if found.data_type in found.STRUCT_TYPES else (1, LONGEST_TEXT)
