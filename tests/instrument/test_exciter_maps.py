"""Tables `[role.exciter]` and `[role.bias]` that name what a map does not have are refused, each thing by its key."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.bench.role_maps import BiasMap, ExciterMap
from palpate.instrument.config import check
from palpate.instrument.contracts.contract import Contract


def wrong(kind: str, role: str, contract: Contract | None = None, **changes: Any) -> list[str]:
    found = device_kind(kind)
    assert found.map is not None
    model: type[ExciterMap | BiasMap] = ExciterMap if role == "exciter" else BiasMap
    return check({**found.map.roles[role], **changes}, model, "role").wrong(contract or found.contract)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"stream": "torque"}, "stream = 'torque' is no process data it takes; valid: set_point"),
        ({"enable": "run"}, "enable = 'run' is no command; valid: shutdown, switch_on, enable, disable, reset"),
        (
            {"fault": ("statusword", "broken")},
            "fault = ['statusword', 'broken'] is no bit of a field; valid bits of it",
        ),
        ({"error": "number"}, "error: 'number' is no field; valid: device_type,"),
        ({"set_up": {"gear": 1}}, "set_up: 'gear' is no field; valid: device_type,"),
    ],
)
def test_an_exciter_that_names_what_the_map_lacks_is_refused(changes: dict[str, Any], said: str) -> None:
    (found,) = wrong("maxon-epos4", "exciter", **changes)
    assert found.startswith(said)


def test_a_drive_without_a_dead_man_is_refused() -> None:
    contract = device_kind("maxon-epos4").contract
    fields = tuple(f for f in contract.fields if f.name != "watchdog")
    (found,) = wrong("maxon-epos4", "exciter", replace(contract, fields=fields))
    assert found.startswith(
        "a drive that goes on with its last set-point needs a dead-man: a field 'watchdog' of 1016h"
    )


def test_set_points_that_wait_for_a_sync_are_refused() -> None:
    contract = device_kind("maxon-epos4").contract
    (pdo,) = contract.receives
    (found,) = wrong("maxon-epos4", "exciter", replace(contract, receives=(replace(pdo, transmission=1),)))
    assert found.startswith("stream = 'set_point' must hold one field in %, and be taken when it arrives")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"level": "state"}, "level: 'state' is no number field that can be written and read; valid: remote, output,"),
        ({"actual": "measured"}, "actual = 'measured' is no number field that can be read; valid: device_class,"),
        ({"ready": "wake"}, "ready = 'wake' is no command; valid: remote, on, off"),
        ({"off": ""}, "on and off: give both, or none"),
    ],
)
def test_a_source_that_names_what_the_map_lacks_is_refused(changes: dict[str, Any], said: str) -> None:
    (found,) = wrong("ea-psb", "bias", **changes)
    assert found.startswith(said)
