"""The command palpate bus lss."""

from __future__ import annotations

import re

import click

from palpate.instrument.errors import UsageError
from palpate.procedures.commands.options import Output, StrictCommand, option, output_options

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
    from palpate.drivers.links.lss import LssAddress
    from palpate.procedures.lab.lss import Change
    from palpate.procedures.lab.operator import at_terminal, confirm

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
