"""Map files: TOML files that describe a device of a maker as a contract, with what else its manual says of it."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args, get_type_hints

from pydantic import AfterValidator, BeforeValidator, PlainValidator, Strict, create_model
from pydantic import Field as Key

from palpate.instrument.config import MOST_PROBLEMS, Config, Name, check, parse, read_bytes
from palpate.instrument.contracts.contract import (
    Command,
    Condition,
    Contract,
    Field,
    Identity,
    Manners,
    Mark,
    Pdo,
    Scaling,
    Value,
    sdo,
)
from palpate.instrument.contracts.declaration import ITSELF, USUAL
from palpate.instrument.errors import ConfigError

# --- rates of serial lines and CAN buses [bit/s], alike in a map and in a bench file ---------------------

BITRATES = range(10_000, 1_000_001)  # of CAN buses
Baudrate = Annotated[int, Key(ge=300, le=4_000_000, strict=True)]
Bitrate = Annotated[int, Key(ge=BITRATES[0], le=BITRATES[-1], strict=True)]


# --- tables whose keys are the attributes of the declarations that they describe -------------------------

OBJECT = re.compile(r"([0-9A-Fa-f]{4}):([0-9A-Fa-f]{1,2})")


def _raw(value: Any) -> Any:
    """A raw value, whole or not, as it stands in the file. Raises ValueError: it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{value!r} is no number; give one without quotes")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{value!r} is not finite; give its bits, as 0x7F800000")
    return value


EXACT: dict[Any, Any] = {  # a text or `true` is no number
    int: Annotated[int, Strict()],
    float: Annotated[float, Strict()],
    float | None: Annotated[float, Strict()] | None,
    int | None: Annotated[int, Strict()] | None,
    Value: Annotated[float, Strict()] | Annotated[str, Strict()],
    tuple[int, int]: tuple[Annotated[int, Strict()], Annotated[int, Strict()]],
    tuple[int, int] | None: tuple[Annotated[int, Strict()], Annotated[int, Strict()]] | None,
    tuple[int, ...]: tuple[Annotated[int, Strict()], ...],
    tuple[float, ...]: tuple[Annotated[Any, PlainValidator(_raw)], ...],
    Mapping[str, int]: Mapping[str, Annotated[int, Strict()]],
}
MADE: dict[type[Config], type] = {}  # for each model of a table, the class of the declaration


def address_of(value: Any) -> Any:
    """An address of a map file: a number, or the index and subindex of an object in hexadecimal, as "6401:1".

    Raises ValueError: it is a text of another form.
    """
    if not isinstance(value, str):
        return value
    found = OBJECT.fullmatch(value)
    if found is None:
        raise ValueError(f'{value!r} is no address; give a number, or index and subindex of an object as "6401:1"')
    return sdo(int(found[1], 16), int(found[2], 16))


def _table(declared: type, **instead: Any) -> type[Config]:
    """A model whose keys are the attributes of a declaration but its name, which is that of the table."""
    hints = get_type_hints(declared)
    keys: dict[str, Any] = {}
    for each in fields(declared):
        if each.name == "name" or not each.init:
            continue
        default = each.default if each.default is not MISSING else ...
        if each.default_factory is not MISSING:
            default = each.default_factory()
        keys[each.name] = (instead.get(each.name, EXACT.get(hints[each.name], hints[each.name])), default)
    model: type[Config] = create_model(f"{declared.__name__}Table", __base__=Config, **keys)
    MADE[model] = declared
    return model


SCALING = _table(Scaling)
CONDITION = _table(Condition)
FIELD = _table(Field, address=Annotated[int, Strict(), BeforeValidator(address_of)], scaling=SCALING | None)
COMMAND = _table(Command, done=CONDITION | None, failed=CONDITION | None)
MANNERS = _table(Manners)
MARK = _table(Mark)
PDO = _table(Pdo)


def made(table: Config, **more: Any) -> Any:
    """The declaration that a checked table describes. Raises ConfigError: it makes no sense."""
    given: Mapping[str, Any] = {key: getattr(table, key) for key in table.model_fields_set}
    inner = {key: made(value) if type(value) in MADE else value for key, value in given.items()}
    return MADE[type(table)](**inner, **more)


# --- tables `[[frame]]`: messages from a manual, and the values that they hold ---------------------------

DOES = re.compile(r"(read|write|command|sends|takes) +([a-z0-9_]+(?: *, *[a-z0-9_]+)*)")
CAN = re.compile(r"([0-9A-Fa-f]{3}): *([0-9A-Fa-f ]*)")
Number = Annotated[float, Key(strict=True, allow_inf_nan=True)]


@dataclass(frozen=True, slots=True)
class WireMessage:
    """A message on the wire: a frame of Modbus RTU with its CRC, or the data of a CAN frame with its COB-ID."""

    data: bytes
    cob_id: int | None = None

    def __str__(self) -> str:
        text = self.data.hex(" ").upper()
        return text if self.cob_id is None else f"{self.cob_id:03X}: {text}"


def _message(text: str) -> WireMessage:
    """Raises ValueError: the text is no message."""
    text = text.replace(",", " ")  # as some manuals print them
    found = CAN.fullmatch(text.strip())
    try:
        return WireMessage(bytes.fromhex(found[2]), int(found[1], 16)) if found else WireMessage(bytes.fromhex(text))
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
    request: Annotated[tuple[WireMessage, ...], BeforeValidator(_messages)] = ()
    reply: Annotated[tuple[WireMessage, ...], BeforeValidator(_messages)] = ()
    values: dict[str, Number | str | tuple[str, ...]] = Key(
        default_factory=dict
    )  # of the fields; of a status word its bits by name
    beside: dict[str, Number] = Key(default_factory=dict)  # values of other fields that tell a scale or a sign
    origin: Literal["printed", "computed"]
    source: str = ""


@dataclass(frozen=True)
class GoldenFrame:
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


def frame_of(number: int, table: FrameTable) -> GoldenFrame:
    """The frame of a checked table."""
    found = DOES.fullmatch(table.says)
    assert found is not None
    return GoldenFrame(number, found[1], tuple(name.strip() for name in found[2].split(",")), table)


# --- the file --------------------------------------------------------------------------------------------

SHIPPED = Path(__file__).parent
NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
LONGEST_NAME = 40  # characters
Link = Literal["modbus-tcp", "modbus-rtu", "canopen"]
Tables = dict[str, dict[str, Any]]


class DeviceTable(Config):
    """The table `[device]`: what it is, and how it is known."""

    name: Annotated[str, Key(pattern=f"^{NAME.pattern}$", max_length=LONGEST_NAME)]
    title: Name
    bus: Literal["modbus", "canopen"]
    links: Annotated[tuple[Link, ...], Key(min_length=1)]
    vendor: Name
    product: str = ""
    revision: str = ""
    about: str = ""
    documents: tuple[str, ...] = ()
    known_by: Literal["identity", "marks", "nothing"] = "identity"
    serial: str = ""


class LineTable(Config):
    """The table `[line]`: settings of the device's serial line or CAN bus, as it leaves the factory."""

    baudrate: Baudrate | None = None
    parity: Literal["N", "E", "O"] | None = None
    stopbits: Annotated[int, Key(ge=1, le=2, strict=True)] | None = None
    unit: Annotated[int, Key(ge=0, le=255, strict=True)] | None = None
    bitrate: Bitrate | None = None
    node: Annotated[int, Key(ge=1, le=127, strict=True)] | None = None


class Sheet(Config):
    """The table `[eds]`: the maker's electronic data sheet (CiA 306) from which the map was made."""

    name: Name
    sha256: Annotated[str, Key(pattern="^[0-9a-f]{64}$")]


class MapFile(Config):
    """A whole map file. The tables of its fields, commands and process data are checked by `read_map`, one by one."""

    file: ClassVar[str] = "map"

    device: DeviceTable
    line: LineTable = LineTable()
    eds: Sheet | None = None
    manners: dict[str, Any] = Key(default_factory=dict)  # keys of each table: see `MANNERS` and its like
    mark: tuple[dict[str, Any], ...] = ()
    field: Annotated[Tables, Key(min_length=1)]
    command: Tables = Key(default_factory=dict)
    sends: Tables = Key(default_factory=dict)
    takes: Tables = Key(default_factory=dict)
    role: Tables = Key(default_factory=dict)
    frame: tuple[dict[str, Any], ...] = ()


@dataclass(frozen=True, eq=False)
class DeviceMap:
    """A device of a maker, as its map file describes it.

    Attributes:
        file: path of the map file.
        sha256: SHA-256 of the file, hexadecimal.
        contract: its registers or objects, its commands and its manners.
        links: kinds of links over which it can be reached, the usual one first.
        line: settings of its serial line or CAN bus, as it leaves the factory.
        roles: for each role that it can fill, the table that names what serves the role.
        frames: frames that prove the contract.
        documents: manuals that tell of it.
        eds: the maker's data sheet from which the map was made; None: there was none.
    """

    file: Path
    sha256: str
    contract: Contract
    links: tuple[Link, ...]
    line: LineTable
    roles: Mapping[str, Mapping[str, Any]]
    frames: tuple[GoldenFrame, ...]
    documents: tuple[str, ...]
    eds: Sheet | None = None

    @property
    def name(self) -> str:
        return self.contract.name


def shipped() -> list[str]:
    """Names of the maps that come with palpate; none of them is read."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


def shipped_map(name: str) -> DeviceMap | None:
    """The map of that name that comes with palpate; None: there is none. Raises ConfigError: it is damaged."""
    path = SHIPPED / f"{name}.toml"
    if not NAME.fullmatch(name) or len(name) > LONGEST_NAME or not path.is_file():
        return None
    found = read_map(path)
    if found.name != name:
        raise ConfigError(f"{path}: device.name is {found.name!r}; it must be {name!r}, as the file is called")
    return found


def read_map(path: Path) -> DeviceMap:
    """Read a map file. Its frames are not proved yet; see `golden_frames.prove`.

    Raises ConfigError: it cannot be read, or says something impossible; each problem with file, table and key.
    """
    return map_of(path, read_bytes(path))


@cache
def map_of(path: Path, data: bytes) -> DeviceMap:
    """The map in the content of a file; it is kept, because a bench asks for its kinds again and again.

    Raises ConfigError as `read_map` does.
    """
    content = parse(data, MapFile, str(path))
    device, read = content.device, _Reader(str(path))
    parts = {
        "fields": read.named("field", FIELD, content.field),
        "pdos": read.named("sends", PDO, content.sends),
        "receives": read.named("takes", PDO, content.takes),
        "commands": read.named("command", COMMAND, content.command),
        "marks": read.listed("mark", MARK, content.mark),
    }
    (manners,) = read.listed("manners", MANNERS, [content.manners]) or (USUAL,)
    frames = tuple(read.frames(content.frame))
    read.refuse()
    read.fits(device, content.line, manners)
    read.refuse()
    try:
        contract = Contract(
            device.name,
            device.title,
            device.bus,
            Identity(device.vendor, device.product, device.revision),
            **parts,
            manners=manners,
            about=device.about,
            known_by=device.known_by,
            serial=device.serial,
        )
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    return DeviceMap(
        path,
        hashlib.sha256(data).hexdigest(),
        contract,
        device.links,
        content.line,
        content.role,
        frames,
        device.documents,
        content.eds,
    )


def _twice(names: Sequence[str]) -> list[str]:
    return [name for number, name in enumerate(names) if name in names[:number]]


class _Reader:
    """Makes the declarations of a map file, and collects what is wrong with them."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._problems: list[str] = []

    def named(self, what: str, model: type[Config], named: Tables) -> tuple[Any, ...]:
        """The declarations of tables such as `[field.NAME]`."""
        return tuple(self._made(f"{what}.{name}", model, table, name=name) for name, table in named.items())

    def listed(self, what: str, model: type[Config], listed: Sequence[Mapping[str, Any]]) -> tuple[Any, ...]:
        """The declarations of tables without a name of their own."""
        return tuple(self._made(what, model, table) for table in listed)

    def _made(self, what: str, model: type[Config], table: Mapping[str, Any], **more: str) -> Any:
        try:
            return made(check(dict(table), model, f"{self._where}: {what}"), **more)
        except ConfigError as error:
            text = str(error)
            self._problems.append(text if text.startswith(self._where) else f"{self._where}: {text}")
            return None

    def frames(self, listed: Sequence[Mapping[str, Any]]) -> Iterator[GoldenFrame]:
        """The frames, numbered as in the file."""
        for number, table in enumerate(listed, 1):
            try:
                yield frame_of(number, check(dict(table), FrameTable, f"{self._where}: frame {number}"))
            except ConfigError as error:
                self._problems.append(str(error))

    def fits(self, device: DeviceTable, line: LineTable, manners: Manners) -> None:
        """Check that links, line and manners are those of its bus."""
        links = [link for link in get_args(Link) if (link == "canopen") == (device.bus == "canopen")]
        if wrong := [link for link in device.links if link not in links] or _twice(device.links):
            self._problems.append(
                f"{self._where}: device.links: {wrong[0]!r}; valid for bus = {device.bus!r}, each once: "
                + ", ".join(links)
            )
        of_bus = ("bitrate", "node") if device.bus == "canopen" else ("baudrate", "parity", "stopbits", "unit")
        if other := sorted(line.model_fields_set - set(of_bus)):
            self._problems.append(
                f"{self._where}: line.{other[0]}: is not for bus = {device.bus!r}; valid: {', '.join(of_bus)}"
            )
        low, high = manners.units
        itself = line.unit in ITSELF and "modbus-tcp" in device.links
        if line.unit is not None and not low <= line.unit <= high and not itself:
            self._problems.append(f"{self._where}: line.unit = {line.unit}, but manners.units are {low} to {high}")

    def refuse(self) -> None:
        """Raises ConfigError: something was wrong."""
        if len(self._problems) > MOST_PROBLEMS:
            more = len(self._problems) - MOST_PROBLEMS
            self._problems[MOST_PROBLEMS:] = [f"{self._where}: and {more} more"]
        if self._problems:
            raise ConfigError("\n".join(self._problems))
