"""The software that a run was taken with, for its record."""

from __future__ import annotations

import functools
import platform
import subprocess
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

from palpate.instrument.additions import Addition, check_ours, packages
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.kinds import GROUP as kind_group
from palpate.instrument.bench.kinds import KINDS
from palpate.instrument.bench.kinds import WHAT as kind_what
from palpate.instrument.sensor.designs import DESIGNS
from palpate.instrument.sensor.designs import GROUP as design_group
from palpate.instrument.sensor.designs import WHAT as design_what
from palpate.simulators.effects import EFFECTS
from palpate.simulators.effects import GROUP as effect_group
from palpate.simulators.effects import WHAT as effect_what
from palpate.simulators.scenes.scene import Scene

PACKAGES = ("palpate", "pymodbus", "python-can", "canopen", "numpy", "scipy")


@functools.cache
def versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on, by name."""
    return {"python": platform.python_version(), **{package: metadata.version(package) for package in PACKAGES}}


def added_by(bench: BenchDescription, scene: Scene | None, procedure: Addition | None = None) -> dict[str, str]:
    """Versions of the installed packages that devices, the design, effects and the procedure come from."""
    kinds = {each.kind.name for each in bench.devices}
    return {
        **packages_of(kinds, {bench.design}, scene.effects if scene is not None else ()),
        **({procedure.package: procedure.version} if procedure is not None and procedure.version else {}),
    }


def packages_of(kinds: Iterable[str], designs: Iterable[str], effects: Iterable[str]) -> dict[str, str]:
    """Versions of the installed packages that add these kinds of devices, designs and effects.

    Raises ConfigError: several packages have one of a name, or a package has one of the name of palpate's own.
    """
    found: dict[str, str] = {}
    for group, what, names, ours in (
        (kind_group, kind_what, kinds, KINDS),
        (design_group, design_what, designs, DESIGNS),
        (effect_group, effect_what, effects, EFFECTS),
    ):
        check_ours(group, what, sorted(ours.keys() & set(names)))
        found |= packages(group, what, set(names) - ours.keys())
    return found


@functools.cache
def commit() -> str | None:
    """Git commit of the source tree, with `-dirty` if files were changed; None: palpate does not run from a clone."""
    tree = Path(__file__).resolve().parents[2]
    if not (tree / ".git").exists():
        return None
    try:
        done = subprocess.run(
            ["git", "-C", str(tree), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"],
            capture_output=True, text=True, check=True, timeout=5,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
