"""Every decoder gives what the bytes hold, or refuses them."""

from __future__ import annotations

from functools import cache
from random import Random

import pytest
from pymodbus.pdu import DecodePDU

from tests.fuzz.target import CORPUS, TARGETS, Target, WronglyAcceptedError, target

NASTIES = sorted(CORPUS.iterdir())
KEPT = cache(target)
decoder = pytest.mark.parametrize("name", TARGETS)


def of(path_name: str) -> Target:
    return KEPT(path_name.rpartition("-")[0])


@decoder
def test_good_inputs_are_accepted(name: str) -> None:
    found = KEPT(name)
    assert [seed for seed in found.seeds if not found.accepts(seed)] == []


@decoder
def test_a_nasty_input_that_was_met_is_refused_or_read_as_it_is(name: str) -> None:
    for nasty in NASTIES:
        if of(nasty.name) is KEPT(name):
            KEPT(name).accepts(nasty.read_bytes())


@decoder
def test_a_changed_input_and_any_other_is_refused_or_read_as_it_is(name: str) -> None:
    found, draw = KEPT(name), Random(name)
    for _ in range(15):
        changed = bytearray(draw.choice(found.seeds))
        for _ in range(draw.randint(0, 4)):
            at = draw.randint(0, len(changed))
            changed[at : at + draw.randint(0, 4)] = draw.randbytes(draw.randint(0, 4))
        found.accepts(bytes(changed))
        found.accepts(draw.randbytes(draw.randint(0, 64)))


@pytest.mark.parametrize("nasty", [path.name for path in NASTIES if path.name.startswith("modbus_tcp-strict")])
def test_the_library_alone_would_take_what_is_no_reply(nasty: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found = target("modbus_tcp")
    monkeypatch.setattr("palpate.drivers.links.modbus.StrictDecoder.decode", DecodePDU.decode)
    with pytest.raises((WronglyAcceptedError, AttributeError)):
        found.decode((CORPUS / nasty).read_bytes())
