"""A killed run that loses what it had acknowledged does not pass for whole, whatever file the damage is in."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from palpate.instrument.errors import RecordError
from palpate.procedures.records import chain
from palpate.procedures.records.chain import SECTOR
from palpate.procedures.records.damage import check
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from palpate.procedures.records.run_folder import HEAD_FILE, RECORD
from tests.procedures.conftest import HEADER

POINTS = 10


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as SIGKILL leaves it after ten durable points."""
    live, folder = (tmp_path_factory.mktemp("store") / name for name in ("live", "killed"))
    with patch.object(chain, "AHEAD", 1000), Recorder.create(live, HEADER) as record:
        for n in range(1, POINTS + 1):
            films = dict.fromkeys(("rigid", "total"), (250.0, np.sin(0.1 * n * np.arange(40))))
            record.point({"load_N": 0.5 * n}, films, n)
        shutil.copytree(live, folder)
    return folder


def is_silent(folder: Path) -> bool:
    """Whether points are gone or changed, and no check says so."""
    if check(folder).faults:
        return False
    try:
        run = Run.open(folder)
        left = [(point["load_N"], run.waveform(point["id"], "rigid")[1]) for point in run.points()]
    except RecordError:
        return False
    return left != [(0.5 * n, np.float32(np.sin(0.1 * n))) for n in range(1, POINTS + 1)]


def damages(content: bytes) -> Iterator[bytes | None]:
    """The file with a bit flipped here and there, cut, and gone."""
    for at in range(5, len(content), max(1, len(content) // 40)):
        yield content[:at] + bytes([content[at] ^ 4]) + content[at + 1 :]
    used = len(content.rstrip(b"\0"))
    for share in (0, 0.3, 0.6, 0.9, 0.99):
        yield content[: int(share * used)]
    yield None


def test_no_damage_to_a_file_of_a_killed_run_costs_points_unnoticed(killed: Path, tmp_path: Path) -> None:
    assert not check(killed).faults
    silent, tried = [], 0
    for victim in sorted(killed.iterdir()):
        for number, content in enumerate(damages(victim.read_bytes())):
            folder = tmp_path / f"{victim.name}-{number}"
            shutil.copytree(killed, folder)
            (folder / victim.name).unlink()
            if content is not None:
                (folder / victim.name).write_bytes(content)
            tried += 1
            silent += [folder.name] * is_silent(folder)
    assert tried > 40
    assert silent == []


@pytest.mark.parametrize("lost", [0, 1])
def test_an_entry_of_the_head_that_is_overwritten_by_the_other_is_noticed(
    killed: Path, tmp_path: Path, lost: int
) -> None:
    """Otherwise the last row, damaged too, would pass for one that the power failed on."""
    folder = tmp_path / "run"
    shutil.copytree(killed, folder)
    head, record = folder / HEAD_FILE, folder / RECORD
    entries = [head.read_bytes()[:SECTOR], head.read_bytes()[SECTOR:]]
    entries[lost] = entries[1 - lost]
    head.write_bytes(b"".join(entries))
    used = record.read_bytes().rstrip(b"\0")
    record.write_bytes(used[:-100] + bytes([used[-100] ^ 1]) + used[-99:])
    assert check(folder).faults
    assert not is_silent(folder)
