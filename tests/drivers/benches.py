"""A simulated bench under test: opened, driven, looked at behind the bus."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from palpate.extend import Bench, BenchDescription
from palpate.instrument import additions as modules
from palpate.instrument.bench import kinds
from palpate.instrument.bench.links import LINKS
from palpate.instrument.config import check
from palpate.simulators.bench import SimulatedBench


def open_bench(sim: SimulatedBench, description: BenchDescription | None = None) -> Bench:
    return Bench(description or sim.description, sim.clock, sim.operator)


def driving(sim: SimulatedBench) -> bool:
    """Whether any of the three means of switching off is not used."""
    generator, amplifier = sim.generator.settings, sim.amplifier.settings
    return bool(generator["amplitude"] or generator["output"] or amplifier["enable"])


def drive(bench: Bench, amplitude: float = 1.0) -> None:
    bench.drive()
    bench.device("signal_generator").sine(10.0, amplitude)


def is_closed(bench: Bench) -> bool:
    modbus = (
        bench.device("signal_generator").link,
        bench.device("shaker_amplifier").link,
        bench.device("strain_indicator").link,
    )
    return not any(link.client.connected for link in modbus) and bench.device("sensor_node_1").link._network is None


def altered(description: BenchDescription, **tables: Any) -> BenchDescription:
    """The same bench but for some keys, such as `device={"positioner": {"unit": 9}}`."""
    data = tomllib.loads(description.to_toml())
    for form in ("link", "device"):
        for name, keys in tables.pop(form, {}).items():
            data[form][name] |= keys
    return check({**data, **tables}, BenchDescription, "bench.toml")


def new_form(description: BenchDescription, prefix: str = "my_") -> dict[str, Any]:
    """The tables of a bench file that lists the same links and devices, the links under other names."""
    kinds = {model: kind for kind, model in LINKS.items()}
    links = {
        prefix + name: {"kind": kinds[type(link)], **link.model_dump(mode="json")}
        for name, link in description.links.items()
    }
    devices = {
        each.name: {
            "kind": each.kind.name,
            "link": prefix + each.link,
            "node" if each.kind.links[0] == "canopen" else "unit": each.unit,
            **each.settings.model_dump(mode="json"),
        }
        for each in description.devices
    }
    top = description.model_dump(mode="json", include={"name", "design", "force_limit", "watchdog", "pickup"})
    return {**top, "link": links, "device": devices}


# --- packages in tests/examples, as if they were installed -------------------------------------------

EXAMPLES = Path(__file__).parents[1] / "examples"


@contextmanager
def installed(*names: str) -> Iterator[list[EntryPoint]]:
    """Inside, the devices of these examples are known: "oven" is acme-oven."""
    entries = [EntryPoint(f"acme-{name}", f"acme_{name}:KIND", kinds.GROUP) for name in names]
    with pytest.MonkeyPatch.context() as patch:
        for name in names:
            patch.syspath_prepend(str(EXAMPLES / name))
        patch.setattr(metadata, "entry_points", lambda group: entries if group == kinds.GROUP else [])
        modules.additions.cache_clear()
        yield entries
    modules.additions.cache_clear()
