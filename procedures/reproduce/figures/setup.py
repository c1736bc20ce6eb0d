"""Figure 5.1a: the set-up with its buses, from the description of the bench that measured chapter 5."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.instrument.bench.links import CanLink, Link, SerialLine
from palpate.instrument.quantity import show
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.reproduce.figures.measured import Measured
from palpate.procedures.reproduce.figures.picture import Picture, canvas, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NUMBER = "Figure 5.1a"
BUSES = {"tcp": "C0", "rtu": "C2", "can": "C1"}
LETTERS = {
    "signal_generator": "B  signal generator",
    "shaker_amplifier": "A  power amplifier",
    "sensor_node": "E, D  sensor node:\ncharge amplifiers, ADC",
}
BOX = (2.3, 0.62)
PC, DEVICE, RIG = 0.0, 4.3, 8.4  # columns
ARROW = {"arrowstyle": "->", "lw": 1.1}


def _bus(link: Link) -> tuple[str, str]:
    """What kind of bus a link is, and what is written above it."""
    if isinstance(link, CanLink):
        return "can", f"CANopen, {show(link.bitrate, 'bit/s')}"
    if isinstance(link, SerialLine):
        return "rtu", f"Modbus RTU line, {show(link.baudrate, 'Bd')}"
    return "tcp", "Modbus TCP"


def draw(measured: Measured, folder: Path) -> Picture:
    """Devices by bus on the left, the rig from shaker to sensor on the right. Raises RecordError."""
    bench = measured.bench
    design = get_design(bench.design)
    names = {bus: name for link in bench.links.values() for bus, name in [_bus(link)]}
    units: dict[tuple[str, str], list[int]] = {}
    for each in bench.devices:
        words = LETTERS.get(each.kind.name, each.kind.contract.title)
        units.setdefault((_bus(bench.links[each.link])[0], words), []).append(each.unit)
    devices = [
        (bus, words, f"{'node' if bus == 'can' else 'unit'} {', '.join(map(str, numbers))}")
        for (bus, words), numbers in sorted(units.items(), key=lambda item: list(BUSES).index(item[0][0]))
    ]
    drawing, (axes,) = canvas(NUMBER)
    drawing.set_size_inches(9.5, 4.8)
    lowest = len(devices) - 1
    _box(axes, PC, -lowest / 2, "palpate", "0.92", height=lowest + BOX[1])
    for place, (bus, words, address) in enumerate(devices):
        _box(axes, DEVICE, -place, words, "white", edge=BUSES[bus])
        axes.plot([PC + BOX[0] / 2, DEVICE - BOX[0] / 2], [-place, -place], color=BUSES[bus], lw=2)
        axes.text(DEVICE - BOX[0] / 2 - 0.08, -place - 0.08, address, ha="right", va="top", fontsize=7)
        if bus in names:  # once, above the first of it
            axes.text(PC + BOX[0] / 2 + 0.08, -place + 0.07, names.pop(bus), fontsize=8, color=BUSES[bus])
    rig = ["C  shaker", "F  load cell", "G  probe", "sample", f"H  sensor, {len(design.films)} films"]
    heights = dict(
        zip(("shaker", "load cell", "probe", "sample", "sensor"), (-lowest / 4 * n for n in range(5)), strict=True)
    )
    for above, below in pairwise(heights.values()):
        axes.plot([RIG, RIG], [above, below], "k", lw=1, zorder=0)
    for words, height in zip(rig, heights.values(), strict=True):
        _box(axes, RIG, height, words, "#f4efe2")
    axes.annotate("", (DEVICE, -1 + BOX[1] / 2), (DEVICE, -BOX[1] / 2), arrowprops=ARROW)
    _arrow(axes, -1, heights["shaker"], "drive")
    if bench.filling("sample_changer"):
        _arrow(axes, -2, heights["sample"] + 0.1, "mounts")
    _arrow(axes, 3 - len(devices), heights["load cell"], "bridge", back=True)
    _arrow(axes, 2 - len(devices), heights["sensor"] + 0.1, "position")
    _arrow(axes, -lowest - 0.1, heights["sensor"] - 0.1, "charge", back=True)
    axes.set(xlim=(-1.3, 9.7), ylim=(-lowest - 0.6, 0.6))
    axes.axis("off")
    caption = (
        f"Ours, from the description of the simulated bench of design {design.name} (input): devices by bus, with their"
        " numbers on it, and the rig. Letters are the thesis'; its oscilloscope D is the ADC of the sensor node."
        " On a real bench only the addresses differ."
    )
    return save(drawing, NUMBER, caption, folder)


def _arrow(axes: Axes, device: float, rig: float, words: str, back: bool = False) -> None:
    """Draw an arrow from a device to a part of the rig at the same height, or back."""
    ends = [(DEVICE + BOX[0] / 2, device), (RIG - BOX[0] / 2, rig)]
    start, end = reversed(ends) if back else ends
    axes.annotate("", end, start, arrowprops=ARROW)
    share = 0.2  # near the device, where arrows do not overlap
    x, y = (a + share * (b - a) for a, b in zip(*ends, strict=True))
    box = {"fc": "white", "ec": "none", "pad": 1}
    axes.text(x, y, words, ha="center", va="center", fontsize=8, color="0.3", bbox=box)


def _box(axes: Axes, x: float, y: float, words: str, fill: str, edge: str = "k", height: float = BOX[1]) -> None:
    from matplotlib.patches import Rectangle

    width = BOX[0]
    axes.add_patch(Rectangle((x - width / 2, y - height / 2), width, height, fc=fill, ec=edge, lw=1.4))
    axes.text(x, y, words, ha="center", va="center", fontsize=9)
