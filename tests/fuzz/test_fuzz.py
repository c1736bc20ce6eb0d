"""Every decoder gives what the bytes hold, or refuses them."""

from __future__ import annotations

from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymodbus.pdu import DecodePDU

from tests.fuzz.corpus import CORPUS
from tests.fuzz.target import Target, WronglyAcceptedError
from tests.fuzz.targets import TARGETS, target

NASTIES = sorted(CORPUS.iterdir())
KEPT = cache(target)
decoder = pytest.mark.parametrize("name", TARGETS)


def of(path_name: str) -> Target:
    return KEPT(path_name.rpartition("-")[0])


@decoder
def test_good_inputs_are_accepted(name: str) -> None:
    found = KEPT(name)
    assert [seed for seed in found.seeds if not found.accepts(seed)] == []


@pytest.mark.parametrize("nasty", [path.name for path in NASTIES])
def test_a_nasty_input_that_was_met_is_refused_or_read_as_it_is(nasty: str) -> None:
    of(nasty).accepts((CORPUS / nasty).read_bytes())


@decoder
@settings(max_examples=15, deadline=None, derandomize=True, database=None)
@given(data=st.data())
def test_a_changed_input_is_refused_or_read_as_it_is(name: str, data: st.DataObject) -> None:
    found = KEPT(name)
    changed = bytearray(data.draw(st.sampled_from(found.seeds)))
    place = st.integers(0, max(len(changed) - 1, 0))
    for at, put in data.draw(st.lists(st.tuples(place, st.binary(max_size=4)), max_size=4)):
        changed[at : at + data.draw(st.integers(0, 4))] = put
    found.accepts(bytes(changed))


@decoder
@settings(max_examples=10, deadline=None, derandomize=True, database=None)
@given(data=st.binary(max_size=64))
def test_any_input_is_refused_or_read_as_it_is(name: str, data: bytes) -> None:
    KEPT(name).accepts(data)


@pytest.mark.parametrize("nasty", [path.name for path in NASTIES if path.name.startswith("modbus_tcp-strict")])
def test_the_library_alone_would_take_what_is_no_reply(nasty: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found = target("modbus_tcp")
    monkeypatch.setattr("palpate.drivers.links.modbus._StrictDecoder.decode", DecodePDU.decode)
    with pytest.raises((WronglyAcceptedError, AttributeError)):
        found.decode((CORPUS / nasty).read_bytes())
