"""The one JSON object that a command prints."""

from __future__ import annotations

import json
import math

import pytest

from palpate.procedures.commands.options import MANY, Output


@pytest.mark.parametrize("entries", [0, 1, MANY + 1])
def test_the_object_is_the_same_however_long_its_lists_are(entries: int, capsys: pytest.CaptureFixture[str]) -> None:
    value = {"name": 'a "line"\nbreak', "none": None, "points": [{"of": [n, n / 3]} for n in range(entries)], "of": {}}
    Output(as_json=True, quiet=False).json(value)
    said = capsys.readouterr().out
    assert json.loads(said) == value
    if entries <= MANY:
        assert said == json.dumps(value, indent=2) + "\n"


def test_each_entry_of_a_long_list_has_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Indented, 1,000 answers with the films of four teeth took longer to write than to find."""
    Output(as_json=True, quiet=False).json({"points": [{"a": [1, 2]}, {"a": [math.inf]}] * MANY})
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 2 * MANY + 4
    assert said[2:4] == ['    {"a": [1, 2]},', '    {"a": [null]},']
