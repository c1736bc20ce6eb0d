"""Sizes and counts are bounded, and each bound says what is too large and what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.drivers.links.can import LARGEST_OBJECT
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.config import DEEPEST, LONGEST_TEXT, MOST_PROBLEMS, MOST_VALUES, parse
from palpate.instrument.errors import ConfigError, LinkError
from palpate.procedures.reproduce.curves import Solutions
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import MOST_EFFECTS
from tests.fuzz.can import NODE, Frames, Transfers, sdo_answers
from tests.fuzz.files import BENCH


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"a = [" + b"1," * MOST_VALUES + b"]", f"has more than {MOST_VALUES} values; leave some out"),
        (b'a = "' + b"x" * (LONGEST_TEXT + 1) + b'"', f"a text of more than {LONGEST_TEXT} characters; shorten it"),
        (b"x" * (LONGEST_TEXT + 1) + b" = 1", f"a text of more than {LONGEST_TEXT} characters; shorten it"),
        (b".".join([b"a"] * (DEEPEST + 2)) + b" = 1", f"more than {DEEPEST} deep; write them side by side"),
        (b"a = " + b"[" * 100_000, "is not TOML"),
        (b"a = " + b"9" * 5000, "is not TOML"),
    ],
)
def test_a_file_is_bounded_in_values_texts_and_depth(content: bytes, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        parse(content, BenchDescription, "bench.toml")


def test_a_file_full_of_strange_keys_tells_the_first_of_them() -> None:
    wrong = b"".join(b"k%d = 1\n" % n for n in range(20_000)) + BENCH
    with pytest.raises(ConfigError, match="is no bench: it has k0, k1, k10, k100 and 19996 more; ") as caught:
        parse(wrong, BenchDescription, "bench.toml")
    assert len(str(caught.value)) < 200


def test_a_table_full_of_errors_tells_the_first_of_them() -> None:
    wrong = b"".join(b"k%d = 1\n" % n for n in range(1000))
    with pytest.raises(ConfigError, match=f"and {1000 - MOST_PROBLEMS} more$") as caught:
        parse(
            BENCH.replace(b"[device.signal_generator]\n", b"[device.signal_generator]\n" + wrong),
            BenchDescription,
            "bench.toml",
        )
    assert len(str(caught.value).splitlines()) == MOST_PROBLEMS + 1


def test_a_scene_is_bounded_in_effects(tmp_path: Path) -> None:
    names = "".join(f"e{n} = 'on'\n" for n in range(MOST_EFFECTS + 1))
    path = tmp_path / "scene.toml"
    path.write_text(f'name = "x"\npurpose = "y"\ndesign = "single"\n[effects]\n{names}')
    with pytest.raises(ConfigError, match=f"effects: .*at most {MOST_EFFECTS}"):
        read_scene(str(path))


def test_an_object_without_end_is_given_up() -> None:
    transfers = Transfers()
    seed = sdo_answers().seeds[-1]
    first, segment = seed[2:10], seed[10:18]
    transfers.network.answers = [b"\x40" + first[1:4] + bytes(4)] + [segment, b"\x10" + segment[1:]] * LARGEST_OBJECT
    with pytest.raises(LinkError, match="no valid answer"):
        transfers.node._text(0x1008_00)
    assert len(transfers.network.answers) > LARGEST_OBJECT


def test_what_a_node_sends_unasked_is_not_kept() -> None:
    transfers, frames = Transfers(), Frames()
    for _ in range(100):
        transfers.node._node.sdo.on_response(0x580 + NODE, bytearray(8), 0.0)
        frames.node._on_frame(0x180 + NODE, bytearray(8), 0.0)
    assert transfers.node._node.sdo.responses.qsize() < 20
    assert frames.node._sizes == b""


def test_damaged_solutions_say_how_to_make_them_anew(tmp_path: Path) -> None:
    shipped = tmp_path / "solutions.json"
    for content in ('{"a": [1.0', '{"a": ["1"]}', "[1]", "[" * 10_000):
        shipped.write_text(content)
        with pytest.raises(ConfigError, match="solve anew: palpate reproduce models --fresh"):
            Solutions.shipped(shipped)
