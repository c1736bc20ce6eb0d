"""The commands palpate bus scan, lss, show and replay."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.instrument.errors import UsageError
from palpate.procedures.commands import texts
from palpate.procedures.commands.options import (
    FILE_NAME,
    OUT,
    PROGRESS,
    Output,
    StrictCommand,
    StrictGroup,
    option,
    output_options,
)

if TYPE_CHECKING:
    from palpate.drivers.scan import FoundDevice, Search


# --- The command palpate bus lss -----------------------------------------------------------------------

NUMBER = re.compile(r"0x(?P<hex>[0-9a-f]{1,8})|(?P<suffixed>[0-9a-f]{1,8})h|(?P<decimal>\d{1,10})", re.IGNORECASE)
LARGEST = 0xFFFF_FFFF


def number(_context: click.Context, given: click.Parameter, text: str) -> int:
    """A number of 32 bits, decimal or as 0x26C or 26Ch. Raises UsageError: it is none."""
    found = NUMBER.fullmatch(text.strip())
    value = LARGEST + 1
    if found is not None:
        value = int(found["decimal"]) if found["decimal"] else int(found["hex"] or found["suffixed"], 16)
    if value > LARGEST:
        raise UsageError(f"--{given.name}: {text!r} is no number of 32 bits; give it as 620, 0x26C or 26Ch")
    return value


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate bus lss --can socketcan:can0 --vendor 26Ch --product 10h --revision 6720000h "
    "--serial 1234 --node 5\n\n  palpate bus lss --can socketcan:can0 --at 125000 --vendor 0x5F --product 1 "
    "--revision 1 --serial 7 --to-bitrate 500000 --save",
)
@option("--can", required=True, metavar="INTERFACE:CHANNEL", help="CAN bus of python-can.")
@option("--at", type=int, default=1_000_000, help="Bit rate of the bus now; wrong, it disturbs a live bus [bit/s].")
@option("--vendor", required=True, callback=number, metavar="NUMBER", help="1018h:1 of the device.")
@option("--product", required=True, callback=number, metavar="NUMBER", help="1018h:2 of the device.")
@option("--revision", required=True, callback=number, metavar="NUMBER", help="1018h:3 of the device.")
@option("--serial", required=True, callback=number, metavar="NUMBER", help="1018h:4 of the device.")
@option("--node", type=int, metavar="ID", help="Node id that it gets.")
@option("--to-bitrate", type=int, metavar="RATE", help="Bit rate that it gets [bit/s]; needs --save.")
@option("--save", is_flag=True, help="Let it keep both when it is switched off.")
@option("--yes", is_flag=True, help="Do not ask before it is written.")
@output_options
def lss(
    can: str,
    at: int,
    vendor: int,
    product: int,
    revision: int,
    serial: int,
    node: int | None,
    to_bitrate: int | None,
    save: bool,
    yes: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Give a CANopen device a node id or a bit rate (LSS, CiA 305).

    The device is chosen by all four numbers of its identity object, so that no other one is changed; palpate bus scan
    shows them. You are asked before anything is written. A node id that another device answers at is refused. The new
    node id holds after a reset, the new bit rate when the device is switched on again. Nothing is kept without --save.
    """
    from palpate.drivers.links.can import LssAddress
    from palpate.procedures.lab.operator import at_terminal, confirm
    from palpate.procedures.lab.scan import Change

    output = Output(as_json, quiet)
    address = LssAddress(vendor, product, revision, serial)
    change = Change.asked(can=can, at=at, address=address, node=node, bitrate=to_bitrate, save=save)
    if not yes and not at_terminal():
        raise UsageError("a person has to agree to it, but standard input is no terminal; give --yes if you do")

    def agreed(what: str) -> None:
        if not yes:
            confirm(what, "yes")

    before = change.carry_out(agreed)
    output.line(f"done: {change}; " + ("switch it off and on" if to_bitrate else "reset it, or switch it off and on"))
    if output.as_json:
        output.json({"before": before, "node": node, "bitrate": to_bitrate, "saved": save})


# --- The command palpate bus scan ----------------------------------------------------------------------


@click.command(
    cls=StrictCommand,
    epilog="Examples:\n\n  palpate bus scan --tcp 192.168.1.20\n\n"
    "  palpate bus scan --line /dev/ttyUSB0 --units 1-32 --out my_bench.toml\n\n"
    "  palpate bus scan --line /dev/ttyUSB0 --baudrates 9600,19200 --parities N,E --every-setting\n\n"
    "  palpate bus scan --can socketcan:can0 --json",
)
@option("--tcp", multiple=True, metavar="HOST[:PORT]", help="Modbus TCP address; may be given again.")
@option("--line", multiple=True, metavar="PORT", help="Serial port; may be given again.")
@option("--can", metavar="INTERFACE:CHANNEL", help="CAN bus of python-can.")
@option("--units", default="1-8", metavar="LIST", help="Modbus unit ids to ask, such as 1-8,16.")
@option("--nodes", default="1-127", metavar="LIST", help="CANopen node ids to ask.")
@option("--baudrates", metavar="LIST", help="Baud rates to try (default: those of known devices, then usual ones).")
@option("--parities", metavar="LIST", help="Parities to try, such as N,E.")
@option("--every-setting", is_flag=True, help="Try the other settings of a line, too, when devices answer at one.")
@option("--bitrates", metavar="LIST", help="Bit rates of the CAN bus to listen at (default: as for --baudrates).")
@option("--listen", callback=texts.quantity("s"), default="1.5 s", help="Time of listening at each bit rate.")
@option("--talk", is_flag=True, help="Ask CAN nodes although no frame has proved the bit rate.")
@option("--timeout", callback=texts.quantity("s"), default="0.2 s", help="Time in which an answer must begin.")
@option("--within", callback=texts.quantity("s"), default="10 min", help="Longest time of the whole search.")
@option("--map", "maps", type=FILE_NAME, multiple=True, metavar="FILE", help="A map of your own to compare with.")
@option("--out", type=FILE_NAME, metavar="FILE", help="Write a bench file begun from what was found.")
@output_options
def scan(
    tcp: tuple[str, ...],
    line: tuple[str, ...],
    can: str | None,
    units: str,
    nodes: str,
    baudrates: str | None,
    parities: str | None,
    every_setting: bool,
    bitrates: str | None,
    listen: float,
    talk: bool,
    timeout: float,
    within: float,
    maps: tuple[Path, ...],
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Find out which devices answer, at which settings and address, and what they are.

    Only reads: Modbus functions 43/14 and 1 to 4, uploads of CANopen objects; no broadcast and no write. Reading can
    still disturb: do not search a bus that somebody else is using. A CAN bus is listened to first, and nodes are asked
    only after frames were heard without an error, because a wrong bit rate disturbs a live bus.

    A kind is told as "is" where its whole identity or all its marks fit. A device that tells nothing by which it is
    known is told as one that "could be" a kind whose registers it has: look at its label. Ctrl-C leaves what was found.
    Exit status 1: nobody answers.
    """
    from palpate.procedures.lab.before import begun_bench
    from palpate.procedures.lab.scan import ScanPlan

    output = Output(as_json, quiet)
    plan = ScanPlan.asked(
        tcp=tcp, lines=line, can=can, units=units, nodes=nodes, baudrates=baudrates, parities=parities,
        every=every_setting, bitrates=bitrates, listen=listen, talk=talk, timeout=timeout, within=within, maps=maps,
    )  # fmt: skip
    if out is not None and out.exists():
        raise UsageError(f"{out} exists; choose another --out")
    if output.for_people:
        click.echo(f"up to {plan.questions} questions, about {plan.seconds:.0f} s if nobody answers", err=True)
    try:
        with output.progress("opening") as progress:
            plan.search.progress = progress
            plan.go()
    finally:  # also after Ctrl-C
        search = plan.search
        if output.as_json:
            output.json(_summary(search))
        _tell(output, search)
        if out is not None and search.found:
            from palpate.procedures.records.run import storing

            with storing(out, "a file in a writable folder with --out"):
                out.write_text(begun_bench(search.found, plan.kinds), encoding="utf-8")
            output.line(f"{out}: begun; complete it, then: palpate sweep loads --bench {out} --dry-run")
    return 0 if plan.search.found else 1


def _tell(output: Output, search: Search) -> None:
    """Print what was found as a table, then what else was heard and what was left out."""
    for each in search.found:
        output.line(f"{_where(each):44} {_what(each)}")
        if each.says:
            output.line(f"    says {each.says}" + (f", serial number {each.serial}" if each.serial else ""))
        if each.doubt:
            output.line(f"    but {each.doubt}")
    if not search.found:
        output.line("nobody answers")
    for text in search.heard:
        output.line(f"heard: {text}")
    for text in search.left:
        output.line(f"not tried: {text}")


def _where(each: FoundDevice) -> str:
    from palpate.drivers.scan import setting_of
    from palpate.instrument.bench.links import SerialLine, TcpLink

    if isinstance(each.link, TcpLink):
        return f"{each.link.host}:{each.link.port} unit {each.unit}"
    if isinstance(each.link, SerialLine):
        return f"{each.link.port} at {setting_of(each.link)} unit {each.unit}"
    return f"{each.link.interface}:{each.link.channel} node {each.unit}"


def _what(each: FoundDevice) -> str:
    simulated = "SIMULATED " if each.simulated else ""
    if each.fits:
        return f"{simulated}is {' or '.join(each.fits)}"
    if each.candidates:
        return f"{simulated}answers, not known; could be {' or '.join(each.candidates)}: look at its label"
    return f"{simulated}answers, not known"


def _summary(search: Search) -> dict[str, object]:
    devices = [
        {
            "link": {"kind": each.kind, **each.link.model_dump(mode="json", exclude={"timeout"})},
            "unit": each.unit,
            "says": each.says,
            "serial": each.serial,
            "fits": list(each.fits),
            "candidates": list(each.candidates),
            "doubt": each.doubt,
            "simulated": each.simulated,
        }
        for each in search.found
    ]
    return {"devices": devices, "heard": search.heard, "left": search.left}


# --- bus show and replay, and the group ----------------------------------------------------------------


@click.group(cls=StrictGroup)
def bus() -> None:
    """Find devices on buses, and look at the traffic of a run, which `--log FILE` of a command with a bench records."""


bus.add_command(scan)
bus.add_command(lss)


@bus.command(
    epilog="Examples:\n\n  palpate sweep loads --log trace.blf\n\n  palpate bus show trace.blf\n\n"
    "  palpate bus show trace.pcapng --json"
)
@click.argument("log", type=FILE_NAME, metavar="FILE")
@output_options
def show(log: Path, as_json: bool, quiet: bool) -> None:
    """Decode a log of all traffic (.pcapng) or of CAN (.blf, .asc, .log of candump), with names, values and units.

    Times are those of the bench's clock, in seconds since the first message. Exit status 1: the log is damaged, or was
    cut off; what precedes that is shown.
    """
    from palpate.procedures.logs import ShownMessage, read_log
    from palpate.procedures.records.chain import check_holes

    output = Output(as_json, quiet)
    check_holes(log)
    messages: list[ShownMessage] = []
    try:
        messages.extend(read_log(log))  # keeps the messages before a damage
        if output.as_json:
            output.json({"file": str(log), "messages": [asdict(message) for message in messages]})
    finally:
        channels = {message.channel for message in messages if message.channel}
        width = max(map(len, channels)) + 2 if len(channels) > 1 else 0
        for message in messages:
            place = message.channel.ljust(width)[:width]
            output.line(f"{message.time - messages[0].time:12.6f}  {place}{message.who:16}  {message.text}")


@bus.command(
    epilog="Examples:\n\n  palpate sweep loads --log trace.blf\n\n  palpate bus replay trace.pcapng"
    "\n\n  palpate bus replay trace.blf --out again --json"
)
@click.argument("log", type=FILE_NAME, metavar="FILE")
@OUT
@PROGRESS
@output_options
def replay(log: Path, out: Path | None, progress: str, as_json: bool, quiet: bool) -> int:
    """Repeat the run of a log: the drivers receive the logged answers, and the points are the same to the byte.

    FILE is the .pcapng file of a log, or the CAN file beside it. Neither devices nor an operator are needed, and no
    time passes. Resulting calibrations are not stored for later runs. The replay stops at the first request that the
    log does not have at this place.
    """
    from palpate.procedures.commands.procedures import tell
    from palpate.procedures.engine.catalogue import class_of
    from palpate.procedures.engine.replay import do_again
    from palpate.procedures.lab.logged import LoggedRun
    from palpate.procedures.records.chain import check_holes

    check_holes(log)
    logged, output = LoggedRun(log), Output(as_json, quiet, progress)
    procedure = class_of(logged.run, "replay").recorded(logged.run)
    with output.listener() as listener:
        done = do_again(procedure, logged, out, listener)
    return tell(procedure, done, output)
