"""The command palpate bus scan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate.instrument.errors import UsageError
from palpate.procedures.commands import texts
from palpate.procedures.commands.options import FILE_NAME, Output, StrictCommand, option, output_options

if TYPE_CHECKING:
    from palpate.drivers.scan.found import FoundDevice, Search


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
    from palpate.procedures.lab.begun_bench import begun_bench
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
    from palpate.drivers.scan.modbus_scan import setting_of
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
