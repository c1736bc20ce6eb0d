"""Faults are data: what a scene may say of them, and that without them there is nothing of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.instrument.errors import ConfigError
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.faults.fault import Fault, Trigger, parse_faults, places
from palpate.simulators.faults.fault import struck as struck_places
from palpate.simulators.planning.settle import read_scene, with_faults
from tests.operations import operations, without_code_of_faults

HEAD = 'name = "x"\npurpose = "y"\ndesign = "single"\n'
FIRST = 'kind = "no_reply"\non = "signal_generator"\n'


def read(folder: Path, *tables: str) -> tuple[Fault, ...]:
    path = folder / "scene.toml"
    path.write_text(HEAD + "".join(f"[[fault]]\n{table}\n" for table in tables))
    return read_scene(str(path)).faults


def test_every_fault_has_a_place_where_it_strikes_and_says_what_it_is() -> None:
    for kind in FAULTS:
        found = fault_class(kind)
        table = {"kind": kind, "on": next(iter(struck_places(found.targets, places(1)))), "transaction": 1}
        if kind == "front_panel":
            table |= {"setting": "amplitude", "value": 1.0}
        (fault,) = parse_faults([table], places(1), "here")
        assert type(fault) is found


def test_a_scene_keeps_its_faults_when_it_is_written_and_read_again(tmp_path: Path) -> None:
    faults = read(tmp_path, FIRST + "transaction = 5", 'kind = "bit_error"\non = "line"\nat = "2 s"\nlasts = "500 ms"')
    assert [(f.kind, f.on, f.at, f.transaction, f.lasts) for f in faults] == [
        ("no_reply", "signal_generator", None, 5, 0.0),
        ("bit_error", "line", 2.0, None, 0.5),
    ]
    again = tmp_path / "again.toml"
    again.write_text(read_scene(str(tmp_path / "scene.toml")).to_toml())
    assert read_scene(str(again)).faults == faults


MAKERS = places(1, read_scene("real_bench").devices)


@pytest.mark.parametrize("kind", ["bridge_open", "overload", "not_a_number", "zero_drift"])
def test_a_makers_load_indicator_has_the_faults_that_its_map_tells(kind: str) -> None:
    (fault,) = parse_faults([{"kind": kind, "on": "load_cell", "at": "1 s"}], MAKERS, "here")
    assert fault.on == "load_cell"


def test_an_indicator_that_reads_integers_never_reads_that_it_is_no_number() -> None:
    table = {"load_cell": {"kind": "laumas-tlb4", "role": "load_indicator", "span": 10.306}}
    standing = places(1, read_scene("ideal").with_devices(table).devices)
    with pytest.raises(ConfigError, match="unknown place of a not_a_number 'load_cell'"):
        parse_faults([{"kind": "not_a_number", "on": "load_cell", "at": "1 s"}], standing, "here")
    assert parse_faults([{"kind": "overload", "on": "load_cell", "at": "1 s"}], standing, "here")


@pytest.mark.parametrize(
    ("kind", "channel", "message"),
    [
        ("saturated_film", 5, "channel: 5 is too large; films has 4"),
        ("counter_skips", None, "unknown place of a counter_skips 'films'"),  # its frames hold no number
    ],
)
def test_a_makers_node_is_refused_what_it_does_not_have(kind: str, channel: int | None, message: str) -> None:
    table = {"kind": kind, "on": "films", "at": "1 s", **({} if channel is None else {"channel": channel})}
    with pytest.raises(ConfigError, match=message):
        parse_faults([table], MAKERS, "here")


WRONG = {
    "no kind": ('on = "line"\nat = "1 s"', ["fault 1: kind", "missing"]),
    "an unknown kind": ('kind = "no_replay"\non = "line"\nat = "1 s"', ["unknown fault 'no_replay'", "'no_reply'?"]),
    "an unknown place": (
        'kind = "no_reply"\non = "signal_genrator"\nat = "1 s"',
        ["place of a no_reply 'signal_genrator' (did you mean 'signal_generator'?)"],
    ),
    "a place that cannot have it": ('kind = "no_reply"\non = "line"\nat = "1 s"', ["unknown place", "'line'"]),
    "a node that is not there": (
        'kind = "node_reboot"\non = "sensor_node_2"\nat = "1 s"',
        ["'sensor_node_2'", "valid: sensor_node_1"],
    ),
    "an unknown key": (FIRST + 'when = "1 s"', ["when", "unknown key", "transaction"]),
    "no time": (FIRST, ["none given of at, transaction, probability"]),
    "two times": (FIRST + 'at = "1 s"\ntransaction = 3', ["at and transaction given of"]),
    "a time without unit": (FIRST + "at = 3", ["at", "needs a unit"]),
    "a negative time": (FIRST + 'at = "-1 s"', ["at", "at least 0"]),
    "transaction nought": (FIRST + "transaction = 0", ["transaction", "at least 1"]),
    "a probability above one": (FIRST + "probability = 1.5", ["probability", "at most 1"]),
    "an unknown setting": (
        'kind = "front_panel"\non = "shaker_amplifier"\nat = "1 s"\nsetting = "gian"\nvalue = 1',
        ["setting of the shaker amplifier 'gian' (did you mean 'gain'?)"],
    ),
    "a setting that the device would refuse": (
        'kind = "front_panel"\non = "shaker_amplifier"\nat = "1 s"\nsetting = "gain"\nvalue = 21',
        ["value: 21 is not allowed", "0 to 20"],
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_fault_is_refused_with_file_number_and_key(wrong: str, tmp_path: Path) -> None:
    text, parts = WRONG[wrong]
    with pytest.raises(ConfigError) as raised:
        read(tmp_path, text)
    message = str(raised.value)
    assert message.startswith(f"{tmp_path / 'scene.toml'}: fault 1: ")
    for part in parts:
        assert part in message


def test_more_faults_than_a_hundred_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="101 faults are more than 100"):
        read(tmp_path, *[FIRST + "transaction = 1"] * 101)


# --- when ----------------------------------------------------------------------------------------------


def struck(fault: dict[str, object], times_ns: list[int], seed: int = 1) -> list[int]:
    (parsed,) = parse_faults([{"kind": "no_reply", "on": "signal_generator", **fault}], places(1), "here")
    trigger = Trigger(parsed, 0, seed)
    return [number for number, now in enumerate(times_ns, 1) if trigger.strikes(now)]


def test_a_fault_strikes_the_nth_transaction_and_goes_on_while_it_lasts() -> None:
    steady = [k * 10**9 for k in range(10)]
    assert struck({"transaction": 4}, steady) == [4]
    assert struck({"transaction": 4, "lasts": "2.5 s"}, steady) == [4, 5, 6]


def test_a_fault_strikes_the_first_transaction_after_its_time_once() -> None:
    steady = [k * 10**9 for k in range(10)]
    assert struck({"at": "3.5 s"}, steady) == [5]
    assert struck({"at": "0 s", "lasts": "2 s"}, steady) == [1, 2]


def test_a_fault_of_a_probability_strikes_by_seed_and_number_alone() -> None:
    first = struck({"probability": 0.2}, [0] * 1000)
    assert first == struck({"probability": 0.2}, list(range(1000)))
    assert first != struck({"probability": 0.2}, [0] * 1000, seed=2)
    assert 160 < len(first) < 240
    assert struck({"probability": 1.0}, [0] * 5) == [1, 2, 3, 4, 5]


FAR = {"on": "signal_generator", "kind": "no_reply", "transaction": 1_000_000}


def test_a_scene_without_faults_does_the_same_operations_where_there_is_no_code_for_any() -> None:
    scene = read_scene("thesis_single")
    operations(scene)  # fills what is kept between benches
    with_code = operations(scene)
    faulty = with_faults(scene, [FAR])
    assert operations(faulty) != with_code
    with without_code_of_faults():
        assert operations(scene) == with_code
        with pytest.raises(ImportError):
            operations(faulty)
