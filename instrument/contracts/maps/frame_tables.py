"""Tables `[[frame]]` of a map file: messages from a manual, and the values that they hold."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator
from pydantic import Field as Key

from palpate.instrument.config import Config

DOES = re.compile(r"(read|write|command|sends|takes) +([a-z0-9_]+(?: *, *[a-z0-9_]+)*)")
CAN = re.compile(r"([0-9A-Fa-f]{3}): *([0-9A-Fa-f ]*)")
Number = Annotated[float, Key(strict=True, allow_inf_nan=True)]


@dataclass(frozen=True, slots=True)
class Message:
    """A message on the wire: a frame of Modbus RTU with its CRC, or the data of a CAN frame with its COB-ID."""

    data: bytes
    cob_id: int | None = None

    def __str__(self) -> str:
        text = self.data.hex(" ").upper()
        return text if self.cob_id is None else f"{self.cob_id:03X}: {text}"


def _message(text: str) -> Message:
    """Raises ValueError: the text is no message."""
    text = text.replace(",", " ")  # as some manuals print them
    found = CAN.fullmatch(text.strip())
    try:
        return Message(bytes.fromhex(found[2]), int(found[1], 16)) if found else Message(bytes.fromhex(text))
    except ValueError:
        raise ValueError(
            f'{text!r} is no message; give bytes as "01 03 00 00", or of a CAN frame "601: 40 30"'
        ) from None


def _messages(value: Any) -> Any:
    """One message, or several of a longer transfer."""
    texts = [value] if isinstance(value, str) else value
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        return value
    return tuple(_message(text) for text in texts)


def _says(text: str) -> str:
    if not DOES.fullmatch(text):
        raise ValueError(
            f'{text!r}: give "read", "write", "command", "sends" or "takes" and names, as "read gross, net"'
        )
    return text


class FrameTable(Config):
    """A table `[[frame]]` of a map file."""

    says: Annotated[str, AfterValidator(_says)]
    request: Annotated[tuple[Message, ...], BeforeValidator(_messages)] = ()
    reply: Annotated[tuple[Message, ...], BeforeValidator(_messages)] = ()
    values: dict[str, Number | str | tuple[str, ...]] = Key(
        default_factory=dict
    )  # of the fields; of a status word its bits by name
    beside: dict[str, Number] = Key(default_factory=dict)  # values of other fields that tell a scale or a sign
    origin: Literal["printed", "computed"]
    source: str = ""


@dataclass(frozen=True)
class Frame:
    """A golden frame.

    Attributes:
        number: its number in its file.
        does: what it shows: `read` or `write` fields, give a `command`, or a PDO that the device `sends` or `takes`.
        names: the fields; or the command or PDO.
        table: its content.
    """

    number: int
    does: str
    names: tuple[str, ...]
    table: FrameTable

    def __str__(self) -> str:
        return f"frame {self.number} ({self.table.says})"


def frame_of(number: int, table: FrameTable) -> Frame:
    """The frame of a checked table."""
    found = DOES.fullmatch(table.says)
    assert found is not None
    return Frame(number, found[1], tuple(name.strip() for name in found[2].split(",")), table)
